#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "ground/control/fence.h"
#include "ground/control/reference_trajectory.h"
#include "ground/control/time_budget.h"
#include "ground/model/inputs.h"
#include "ground/model/pushed_step.h"
#include "ground/model/tunable.h"

namespace ground {

/// Cost of a plan: weights of squares of the state error at the end of each step, and of the
/// inputs. They are relative to the weight of the position error, which is 1 per m^2.
struct PlanWeights {
  double velocity = 0.1;     ///< weight of the velocity error [s^2]
  double input = 1e-5;       ///< weight of the inputs, relative to full scale [m^2]
  /// Weight of turning [m^2]: of the sum of all inputs, relative to full scale, each times its
  /// lever over l. For the pair this is the inputs' difference.
  double turning = 1e-3;
  double end_position = 50;  ///< additional weight of the position error at the end [-]
  double end_velocity = 1;   ///< additional weight of the velocity error at the end [s^2]

  static const Tunables<PlanWeights>& table();
};

/// Plans the inputs of a craft's thrusters over a horizon by an iterative linear-quadratic
/// regulator with bounds on the inputs (Tassa, Mansard, Todorov, Control-limited differential
/// dynamic programming, 2014): Gauss-Newton with exact derivatives of the model. Allocates memory
/// only at construction. A thruster whose force curve is flat at 0 has no derivative there: it gets
/// that of a small input.
class TrajectoryOptimizer {
 public:
  static constexpr int kStates = 6 + kMaxStates;
  static constexpr int kMaxSteps = 200;
  using State = Eigen::Matrix<double, kStates, 1>;  ///< eta, nu, states of effects

  /// Steps are `step` [s] long. Throws std::invalid_argument if the model's effects have more than
  /// kMaxStates states or the horizon is bad.
  static std::unique_ptr<TrajectoryOptimizer> make(const Model& model, int steps, double step);
  virtual ~TrajectoryOptimizer() = default;
  void setWeights(const PlanWeights& weights) { weights_ = weights; }
  /// Sets walls to avoid; without value, no walls.
  void setWalls(const std::optional<PlanWalls>& walls) { walls_ = walls; }

  /// Sets a budget, which must outlive this object. When its time is up, improve() ends early.
  void setBudget(TimeBudget& budget) { budget_ = &budget; }

  int steps() const { return static_cast<int>(plan_.inputs.size()); }
  double step() const { return step_; }

  /// Sets the problem: the state `start` at t [s] of the drive, references at the end of every
  /// step, and a constant acceleration in addition to the model (body; m/s^2, m/s^2, rad/s^2).
  /// Call rollOut() or carryOn() after it.
  void setProblem(double t, const State& start, double lift, const Vector3<double>& missing,
                  const std::vector<ReferencePoint>& references);
  /// The plan's inputs, in the model's units.
  const std::vector<Thrusters<double>>& inputs() const { return plan_.inputs; }
  /// The same, to set another plan. Call rollOut() afterwards.
  std::vector<Thrusters<double>>& newInputs() {
    has_gains_ = false;
    damping_ = 0;
    return plan_.inputs;
  }
  /// Simulates the plan; returns its cost [m^2 s].
  double rollOut();
  /// Continues the plan for a problem that begins `shift` [s] >= 0 after the problem that it was
  /// made for. Each step gets the mean of the inputs planned for its time, once as they are, and
  /// once with the feedback of the last iteration on deviations from the planned states. The
  /// cheaper of the two becomes the plan. Returns its cost [m^2 s].
  virtual double carryOn(double shift) = 0;
  /// One iteration; returns whether the cost decreased. If not, the plan is the same as before. If
  /// the quadratic problem predicts a relative decrease below `slight`, the change is not simulated:
  /// the plan's inputs, states and cost are then those of the linearised problem.
  virtual bool improve(double slight = 0) = 0;
  double cost() const { return cost_; }
  /// Acceleration in addition to the model, of the problem.
  const Vector3<double>& missing() const { return missing_; }
  /// The plan's first inputs before saturation, in the model's units: an input at a bound is
  /// replaced by the minimum of the last iteration's quadratic problem without bounds on that step.
  Thrusters<double> wanted() const;
  /// Root mean square of the position error along the plan [m].
  double error() const;
  /// At the start and after each step.
  const std::vector<State>& states() const { return plan_.states; }

  /// Limits inputs to the ranges of the thrusters, in the model's units.
  Thrusters<double> clipped(const Thrusters<double>& inputs) const {
    return dynamics_.layout().clipped(inputs, input_max_);
  }

 protected:
  TrajectoryOptimizer(const Model& model, int steps, double step);

  int thrusterCount() const { return dynamics_.layout().size(); }
  /// A plan as it is simulated.
  struct Trial {
    std::vector<Thrusters<double>> inputs;
    std::vector<State> states;  ///< at the start, after each step

    Trial(int steps, int thrusters);
  };
  double stateCost(int k, const RigidState<double>& state) const;
  double inputCost(const Thrusters<double>& input) const;
  /// Derivatives of a state's cost by x, y, psi, u and v, on which it depends.
  struct CostDerivatives {
    Eigen::Matrix<double, 5, 1> gradient = Eigen::Matrix<double, 5, 1>::Zero();
    Eigen::Matrix<double, 5, 5> curvature = Eigen::Matrix<double, 5, 5>::Zero();
  };
  /// Derivatives of the cost of the state at the end of step k of the plan.
  CostDerivatives stateCostDerivatives(int k) const;
  /// Simulates inputs, which plan(k, state) gives, until the cost reaches `limit`; returns the cost.
  template <class Plan>
  double tryOut(double limit, const Plan& plan);
  /// Makes the tried inputs the plan.
  void take(double cost);
  /// Whether there is time for another piece of work.
  bool timeLeft() { return !budget_ || budget_->left(); }
  /// Whether there is time for step k of a loop over the steps.
  bool timeFor(int k) {
    constexpr int kPiece = 8;  // steps in a piece of work; reading a clock takes time, too
    return k % kPiece == 0 ? timeLeft() : !budget_ || !budget_->isUp();
  }

  Dynamics<double> dynamics_;
  Dynamics<Jet> derivatives_;
  int effect_states_;
  double input_max_;
  Thrusters<double> levers_;       ///< of the thrusters, over l
  Thrusters<double> least_input_;  ///< smallest inputs at which derivatives are taken
  PlanWeights weights_;
  std::optional<PlanWalls> walls_;
  TimeBudget* budget_ = nullptr;
  double step_;
  double t_ = 0, lift_ = 1;
  Vector3<double> missing_ = Vector3<double>::Zero();
  std::vector<ReferencePoint> references_;
  Trial plan_, tried_;
  State start_ = State::Zero();
  double cost_ = 0;
  bool is_linear_ = false;  ///< whether the derivatives are those of the plan
  bool is_simulated_ = true;  ///< whether states and cost are those of a simulation
  bool has_gains_ = false;  ///< whether the gains are those of the plan
  double damping_ = 0;      ///< of the next iteration of this plan
  /// First inputs of the last iteration without bounds; NaN before it.
  Thrusters<double> unbounded_;
};

}  // namespace ground
