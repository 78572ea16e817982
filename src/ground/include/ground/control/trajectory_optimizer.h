#pragma once

#include <optional>
#include <vector>

#include "ground/control/fence.h"
#include "ground/control/reference_trajectory.h"
#include "ground/model/pushed_step.h"
#include "ground/model/tunable.h"

namespace ground {

/// What a plan costs, by the state at the end of each of its steps and by its inputs. The weights
/// compare with that of the position error, which is 1 per m^2.
struct PlanWeights {
  double velocity = 0.1;     ///< of the velocity error [s^2]
  double input = 1e-5;       ///< of the inputs, of full scale [m^2]
  double turning = 1e-3;     ///< of the difference of the inputs, of full scale [m^2]
  double end_position = 50;  ///< of the position error at the end, as often as along the way
  double end_velocity = 1;   ///< of the velocity error at the end [s^2]

  static const Tunables<PlanWeights>& table();
};

/// Plans the inputs of a craft over a horizon: iterative linear-quadratic regulator with bounds on
/// the inputs (Tassa, Mansard, Todorov, Control-limited differential dynamic programming, 2014),
/// Gauss-Newton, with exact derivatives of the model. Everything is allocated at construction.
class TrajectoryOptimizer {
 public:
  static constexpr int kStates = 6 + kMostStates;
  static constexpr int kMostSteps = 200;
  using State = Eigen::Matrix<double, kStates, 1>;  ///< eta, nu, states of effects

  /// Steps are `step` [s] long. Throws std::invalid_argument when the model's effects
  /// have more than kMostStates states or the horizon is bad.
  TrajectoryOptimizer(const Model& model, int steps, double step);
  void setWeights(const PlanWeights& weights) { weights_ = weights; }
  /// Walls to keep away from; none for a floor without bounds.
  void setWalls(const std::optional<PlanWalls>& walls) { walls_ = walls; }

  int steps() const { return static_cast<int>(inputs_.size()); }
  double step() const { return step_; }

  /// The problem: from `start` at t [s] of the drive, with references at the end of every step,
  /// under a constant acceleration beside the model (body; m/s^2, m/s^2, rad/s^2).
  void setProblem(double t, const State& start, double lift, const Vector3<double>& missing,
                  const std::vector<ReferencePoint>& references);
  /// The plan's inputs left, right, in the model's units; to be followed by rollOut().
  std::vector<Vector2<double>>& inputs() { return inputs_; }
  /// Follows the plan; its cost [m^2 s].
  double rollOut();
  /// One iteration; whether the cost fell.
  bool improve();
  double cost() const { return cost_; }
  /// The plan's first inputs, and where one of them is at a bound, what the last iteration's quadratic
  /// problem would take instead if that step had no bounds; in the model's units.
  Vector2<double> wanted() const;
  /// Root mean square of the position error along the plan [m].
  double error() const;
  const std::vector<State>& states() const { return states_; }  ///< start and after every step

 private:
  using Square = Eigen::Matrix<double, kStates, kStates>;
  using Drive = Eigen::Matrix<double, kStates, 2>;
  using Gain = Eigen::Matrix<double, 2, kStates>;
  struct Linear {
    Square A;
    Drive B;
  };

  /// The craft one step on, the k-th of the horizon.
  State advance(int k, const State& state, const Vector2<double>& input) const;
  void linearize(int k);
  void addStateCost(int k, State& gradient, Square& curvature) const;
  void addWallCost(const State& state, State& gradient, Square& curvature) const;
  static Gain feedback(const Eigen::Matrix2d& damped, const Gain& Qux,
                       const std::array<bool, 2>& free);
  bool backward();
  double stateCost(int k, const State& state) const;
  double inputCost(const Vector2<double>& input) const;

  Dynamics<double> dynamics_;
  Dynamics<Jet> derivatives_;
  int effect_states_;
  double input_max_;
  PlanWeights weights_;
  std::optional<PlanWalls> walls_;
  double step_;
  double t_ = 0, lift_ = 1;
  Vector3<double> missing_ = Vector3<double>::Zero();
  std::vector<ReferencePoint> references_;
  std::vector<Vector2<double>> inputs_, tried_inputs_, open_;
  std::vector<State> states_, tried_states_;
  std::vector<Linear> linear_;
  std::vector<Gain> gains_;
  double cost_ = 0;
  double damping_ = 0;
  Vector2<double> unbounded_;  ///< first inputs of the last iteration without bounds; NaN before it
};

}  // namespace ground
