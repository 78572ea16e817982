#pragma once

#include <optional>
#include <vector>

#include "ground/control/box_minimum.h"
#include "ground/control/plan_walls.h"
#include "ground/control/reference_trajectory.h"
#include "ground/model/inputs.h"
#include "ground/model/pushed_step.h"
#include "ground/parameters/PlanWeights.h"

namespace ground {

/// Plans the inputs of a craft's thrusters over a horizon by box-DDP: an iterative linear-quadratic
/// regulator with bounds on the inputs (Tassa, Mansard, Todorov, Control-limited differential
/// dynamic programming, 2014), in its Gauss-Newton form with exact derivatives of the model.
/// Allocates memory only at construction. A thruster whose force curve is flat at 0 has no
/// derivative there: it gets the derivative at a small input.
class TrajectoryOptimizer {
 public:
  static constexpr int kStates = 6 + kMaxStates;
  static constexpr int kMaxSteps = 200;
  using State = Eigen::Matrix<double, kStates, 1>;  ///< eta, nu, states of effects

  /// Steps are `step` [s] long. The model's effects have at most kMaxStates states. Throws
  /// std::invalid_argument if the horizon is bad.
  TrajectoryOptimizer(const Model& model, int steps, double step);
  void setWeights(const PlanWeights& weights) { weights_ = weights; }
  /// Sets walls to avoid; without value, no walls.
  void setWalls(const std::optional<PlanWalls>& walls) { walls_ = walls; }

  int steps() const { return static_cast<int>(plan_.inputs.size()); }
  double step() const { return step_; }

  /// Sets the problem: the state `start` at t [s] of the drive, references at the end of every
  /// step, lift and voltage over the horizon, and a constant acceleration in addition to the model
  /// (body; m/s^2, m/s^2, rad/s^2). Call rollOut() or warmStart() after it.
  void setProblem(double t, const State& start, const Conditions<double>& given,
                  const Vector3<double>& missing, const std::vector<ReferencePoint>& references);
  /// The plan's inputs, in the model's units.
  const std::vector<Thrusters<double>>& inputs() const { return plan_.inputs; }
  /// The plan's inputs, to set another plan. Call rollOut() afterwards.
  std::vector<Thrusters<double>>& newInputs();
  /// Simulates the plan; returns its cost [m^2 s].
  double rollOut();
  /// Continues the plan for a problem that begins `shift` [s] >= 0 after the problem that it was
  /// made for. Each step gets the mean of the inputs planned for its time, once as they are, and
  /// once with the feedback of the last iteration on deviations from the planned states. The
  /// cheaper of the two becomes the plan. Returns its cost [m^2 s].
  double warmStart(double shift);
  /// One iteration; returns whether the cost decreased. If not, the plan is the same as before.
  bool improve();
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

 private:
  using Square = Eigen::Matrix<double, kStates, kStates>;
  using StatesByInputs = Eigen::Matrix<double, kStates, Eigen::Dynamic, 0, kStates, kMaxThrusters>;

  struct Trajectory {
    std::vector<Thrusters<double>> inputs;
    std::vector<State> states;  ///< at the start, after each step
  };
  /// Derivatives of the state after a step, and the step's policy: the change u + k + K (x - x_plan).
  struct Stage {
    Square fx;
    StatesByInputs fu;
    PerThruster k;
    StatesByInputs K;  ///< transposed
  };
  /// Derivatives of a state's cost by x, y, psi, u and v, on which it depends.
  struct CostDerivatives {
    Eigen::Matrix<double, 5, 1> gradient = Eigen::Matrix<double, 5, 1>::Zero();
    Eigen::Matrix<double, 5, 5> curvature = Eigen::Matrix<double, 5, 5>::Zero();
  };

  double stateCost(std::size_t i, const RigidState<double>& state) const;
  CostDerivatives stateCostDerivatives(std::size_t i) const;
  double inputCost(const Thrusters<double>& input) const;
  template <class Policy>
  double simulate(double limit, const Policy& policy);
  void accept(double cost);
  void linearize(std::size_t i);
  template <int kSize, int kInputs>
  bool backwardPass();
  Thrusters<double> withFeedback(std::size_t i, double length, const State& state) const;
  void shiftPlan(double shift);

  Dynamics<double> dynamics_;
  Dynamics<Jet> derivatives_;
  int count_;  ///< number of states in use
  double input_max_;
  PerThruster low_, high_;         ///< ranges of the inputs
  PerThruster levers_;             ///< of the thrusters, over l
  Thrusters<double> least_input_;  ///< smallest inputs at which derivatives are taken
  std::vector<int> variables_;     ///< of the derivatives: states, then inputs from kStates on
  PlanWeights weights_;
  std::optional<PlanWalls> walls_;
  double step_;
  double t_ = 0;
  Conditions<double> given_{1, std::nullopt};
  Vector3<double> missing_ = Vector3<double>::Zero();
  State start_ = State::Zero();
  std::vector<ReferencePoint> references_;
  Trajectory plan_, tried_;
  std::vector<Stage> stages_;
  double cost_ = 0;
  bool is_linear_ = false;  ///< whether the derivatives belong to the plan
  bool has_gains_ = false;  ///< whether the gains belong to the plan
  double damping_ = 0;      ///< of the next iteration of this plan
  /// First inputs of the last iteration without bounds; NaN before it.
  Thrusters<double> unbounded_;
};

}  // namespace ground
