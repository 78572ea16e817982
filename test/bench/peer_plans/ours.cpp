// Our planner and its problems for peer_plans.py.
#include <algorithm>

#include "plan_cases.h"
#include "problem.h"

namespace {

using namespace ground;
using namespace ground::plan_cases;
using State = TrajectoryOptimizer::State;

void fill(PlanProblem& problem, const State& start, const Vector3<double>& missing,
          const ReferenceTrajectory& reference, double since) {
  const double step = plan_cost_weights().step;
  std::copy_n(start.data(), kStates, problem.start);
  std::copy_n(missing.data(), 3, problem.missing);
  for (int k = 0; k < kSteps; ++k) {
    const ReferencePoint point = reference.at(std::max(0.0, since + (k + 1) * step));
    double* row = problem.references[k];
    row[0] = point.p.x(), row[1] = point.p.y();
    row[2] = point.p_dot.x(), row[3] = point.p_dot.y();
  }
}

TrajectoryOptimizer& optimizerOf(const PlanProblem& problem) {
  static const PredictiveParams params;
  static const std::unique_ptr<TrajectoryOptimizer> optimizer =
      std::make_unique<TrajectoryOptimizer>(craft(), kSteps, params.horizon / kSteps);
  State start = State::Zero();
  std::copy_n(problem.start, kStates, start.data());
  std::vector<ReferencePoint> references(kSteps);
  for (int k = 0; k < kSteps; ++k) {
    const double* row = problem.references[k];
    references[static_cast<std::size_t>(k)].p = {row[0], row[1]};
    references[static_cast<std::size_t>(k)].p_dot = {row[2], row[3]};
  }
  optimizer->setWeights(params);
  optimizer->setProblem(0, start, {1, std::nullopt}, Eigen::Map<const Vector3<double>>(problem.missing),
                        references);
  return *optimizer;
}

struct DecidedFlight {
  Model model = craft();
  ReferencePtr reference;
  Flight flight;
  PredictiveControl control{model, {}};
  std::vector<Thrusters<double>> inputs;  ///< of the previous plan
  std::vector<State> states;
  int decision = 0;

  explicit DecidedFlight(ReferencePtr followed) : reference(std::move(followed)), flight(model, reference) {}

  /// The previous plan, shifted by a period as TrajectoryOptimizer::warmStart() does.
  void guess(PlanProblem& problem) const {
    const double part = kPeriod / plan_cost_weights().step;
    const double turn = problem.start[2] - states[0](2);
    for (int k = 0; k < kSteps; ++k) {
      const auto here = static_cast<std::size_t>(k), next = std::min<std::size_t>(here + 1, kSteps - 1);
      for (int i = 0; i < kInputs; ++i)
        problem.inputs[k][i] = (1 - part) * inputs[here](i) + part * inputs[next](i);
    }
    for (int k = 0; k <= kSteps; ++k) {
      const auto here = static_cast<std::size_t>(k), next = std::min<std::size_t>(here + 1, kSteps);
      for (int i = 0; i < kStates; ++i)
        problem.states[k][i] = (1 - part) * states[here](i) + part * states[next](i);
      problem.states[k][2] += turn - wrapAngle(turn);
    }
    std::copy_n(problem.start, kStates, problem.states[0]);
  }
};

}  // namespace

PlanCost plan_cost_weights() {
  const PredictiveParams params;
  const PlanWeights& w = params;
  return {params.horizon / params.steps, w.velocity, w.input, w.turning, w.end_position, w.end_velocity};
}

void plan_body(double* body) {
  const Body<double> b = craft().body;
  for (double value : {b.m, b.l, b.I_z, b.X_u, b.Y_v, b.N_r, b.k}) *body++ = value;
}

double plan_cost(const PlanProblem* problem, const double* inputs) {
  TrajectoryOptimizer& optimizer = optimizerOf(*problem);
  for (std::size_t k = 0; k < kSteps; ++k)
    for (int i = 0; i < kInputs; ++i) optimizer.newInputs()[k](i) = inputs[kInputs * k + i];
  return optimizer.rollOut();
}

void plan_step(const double* missing, const double* state, const double* input, double* next,
               double* derivatives) {
  static const double step = plan_cost_weights().step;
  static const Dynamics<double> plain(craft());
  static const Dynamics<Jet> exact(craft());
  const Eigen::Map<const Vector3<double>> push(missing);
  const auto move = [&](const auto& dynamics, auto zero, const auto& each) {
    using T = decltype(zero);
    RigidState<T> body;
    Thrusters<T> command = Thrusters<T>::zero(kInputs);
    for (int i = 0; i < 3; ++i) {
      body.eta(i) = each(state[i], i);
      body.nu(i) = each(state[3 + i], 3 + i);
    }
    for (int i = 0; i < kInputs; ++i) command(i) = each(input[i], kStates + i);
    const Vector3<T> pushed = push.template cast<T>();
    return drivenStep<T>(dynamics, T(0.0), body, command, {1.0, std::nullopt}, pushed, step, nullptr);
  };
  if (!derivatives) {
    const RigidState<double> after = move(plain, 0.0, [](double x, int) { return x; });
    std::copy_n(after.eta.data(), 3, next);
    std::copy_n(after.nu.data(), 3, next + 3);
    return;
  }
  const RigidState<Jet> after = move(exact, Jet(0.0), [](double x, int i) {
    Jet variable(x);
    // The positions have no influence on the velocities: heading, velocities and inputs remain.
    if (i >= 2) variable.v[i - 2] = 1;
    return variable;
  });
  std::fill_n(derivatives, kStates * (kStates + kInputs), 0.0);
  for (int i = 0; i < kStates; ++i) {
    const Jet& one = i < 3 ? after.eta(i) : after.nu(i - 3);
    next[i] = one.a;
    double* row = derivatives + i * (kStates + kInputs);
    if (i < 2) row[i] = 1;
    for (int j = 2; j < kStates + kInputs; ++j) row[j] = one.v[j - 2];
  }
}

void* plan_flight(int reference) {
  return new DecidedFlight(references()[static_cast<std::size_t>(reference)].second);
}

double plan_flight_next(void* flight, PlanProblem* problem, double* inputs) {
  auto& of = *static_cast<DecidedFlight*>(flight);
  const double t = of.decision++ * kPeriod;
  const Observation seen = of.flight.observe(t);
  const double before = processorTime();
  const Thrusters<double> chosen = of.control.decide(seen);
  const double seconds = processorTime() - before;
  const TrajectoryOptimizer& plan = of.control.plan();
  fill(*problem, plan.states()[0], plan.missing(), *of.reference, t);
  if (!of.inputs.empty()) of.guess(*problem);
  of.inputs = plan.inputs();
  of.states = plan.states();
  for (std::size_t k = 0; k < kSteps; ++k)
    for (int i = 0; i < kInputs; ++i) inputs[kInputs * k + i] = of.inputs[k](i);
  of.control.commanded(t, chosen, 1);
  of.flight.command(t, chosen);
  return seconds;
}

void plan_flight_end(void* flight) { delete static_cast<DecidedFlight*>(flight); }

void plan_cold(int number, PlanProblem* problem, double* costs, double* seconds) {
  const ColdStart start = coldStart(static_cast<unsigned>(number));
  PredictiveControl control(craft(), {});
  double sum = 0;
  for (int i = 0; i < 50; ++i) {
    const double before = processorTime();
    control.decide(start.observation());
    seconds[i] = sum += processorTime() - before;
    costs[i] = control.plan().cost();
  }
  fill(*problem, control.plan().states()[0], control.plan().missing(), *start.reference, start.since);
  // The plan that a controller begins with: half of the full thrust.
  std::copy_n(problem->start, kStates, problem->states[0]);
  for (int k = 0; k < kSteps; ++k) {
    std::fill_n(problem->inputs[k], kInputs, 0.5);
    plan_step(problem->missing, problem->states[k], problem->inputs[k], problem->states[k + 1], nullptr);
  }
}

double plan_cold_best(const PlanProblem* problem, int number) {
  return bestOfMany(optimizerOf(*problem), 60, static_cast<unsigned>(number));
}
