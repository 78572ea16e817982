// A problem of the planner and its parts as plain arrays, for peers in C++ and in Python.
#pragma once

extern "C" {

enum { kStates = 6, kInputs = 2, kSteps = 40 };

/// A problem, and the plan from which every contender starts.
struct PlanProblem {
  double start[kStates];         ///< eta, nu
  double missing[3];             ///< additional acceleration (body)
  double references[kSteps][4];  ///< position and velocity at the end of each step
  double inputs[kSteps][kInputs];
  double states[kSteps + 1][kStates];  ///< may have gaps: no roll-out of the inputs
};

/// Weights of the cost [m^2 s], as in PlanWeights, and the length of a step [s].
struct PlanCost {
  double step, velocity, input, turning, end_position, end_velocity;
};
PlanCost plan_cost_weights();
/// m, l, I_z, X_u, Y_v, N_r and k of the craft.
void plan_body(double* body);
/// The cost of inputs by the roll-out of TrajectoryOptimizer.
double plan_cost(const PlanProblem* problem, const double* inputs);

/// The state after a step; with `derivatives`, also those by states, then by inputs (a row for each
/// state). The model is that of TrajectoryOptimizer.
void plan_step(const double* missing, const double* state, const double* input, double* next,
               double* derivatives);

/// Ours. A flight on a reference; each call of plan_flight_next() makes a decision of
/// ModelPredictive and returns its processor time [s], with its problem and inputs.
void* plan_flight(int reference);
double plan_flight_next(void* flight, PlanProblem* problem, double* inputs);
void plan_flight_end(void* flight);
/// The cost of a cold start after each of 50 decisions and the processor time until then [s].
void plan_cold(int number, PlanProblem* problem, double* costs, double* seconds);
/// Least cost of 60 random starts of our optimizer, each improved until nothing changes.
double plan_cold_best(const PlanProblem* problem, int number);

/// Crocoddyl: BoxFDDP, or BoxDDP. Writes the processor time [s] and the inputs after each
/// iteration, at most `most`; returns their number. `cost` is the peer's own of its last plan.
int crocoddyl_solve(const PlanProblem* problem, int is_fddp, int most, double* seconds, double* inputs,
                    double* cost);
}
