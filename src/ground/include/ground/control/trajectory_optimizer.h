#pragma once

#include <optional>
#include <vector>

#include "ground/control/fence.h"
#include "ground/control/reference_trajectory.h"
#include "ground/model/pushed_step.h"
#include "ground/model/tunable.h"

namespace ground {

/// Cost of a plan: weights of squares of the state error at the end of each step, and of the
/// inputs. They are relative to the weight of the position error, which is 1 per m^2.
struct PlanWeights {
  double velocity = 0.1;     ///< weight of the velocity error [s^2]
  double input = 1e-5;       ///< weight of the inputs, relative to full scale [m^2]
  double turning = 1e-3;     ///< weight of the inputs' difference, relative to full scale [m^2]
  double end_position = 50;  ///< additional weight of the position error at the end [-]
  double end_velocity = 1;   ///< additional weight of the velocity error at the end [s^2]

  static const Tunables<PlanWeights>& table();
};

/// Plans the inputs of a craft over a horizon by an iterative linear-quadratic regulator with
/// bounds on the inputs (Tassa, Mansard, Todorov, Control-limited differential dynamic programming,
/// 2014): Gauss-Newton with exact derivatives of the model. Allocates memory only at construction.
class TrajectoryOptimizer {
 public:
  static constexpr int kStates = 6 + kMaxStates;
  static constexpr int kMaxSteps = 200;
  using State = Eigen::Matrix<double, kStates, 1>;  ///< eta, nu, states of effects

  /// Steps are `step` [s] long. Throws std::invalid_argument if the model's effects have more than
  /// kMaxStates states or the horizon is bad.
  TrajectoryOptimizer(const Model& model, int steps, double step);
  void setWeights(const PlanWeights& weights) { weights_ = weights; }
  /// Sets walls to avoid; without value, no walls.
  void setWalls(const std::optional<PlanWalls>& walls) { walls_ = walls; }

  int steps() const { return static_cast<int>(inputs_.size()); }
  double step() const { return step_; }

  /// Sets the problem: the state `start` at t [s] of the drive, references at the end of every
  /// step, and a constant acceleration in addition to the model (body; m/s^2, m/s^2, rad/s^2).
  void setProblem(double t, const State& start, double lift, const Vector3<double>& missing,
                  const std::vector<ReferencePoint>& references);
  /// The plan's inputs left, right, in the model's units. Call rollOut() after changing them.
  std::vector<Vector2<double>>& inputs() { return inputs_; }
  /// Simulates the plan; returns its cost [m^2 s].
  double rollOut();
  /// One iteration; returns whether the cost decreased.
  bool improve();
  double cost() const { return cost_; }
  /// The plan's first inputs before saturation, in the model's units: an input at a bound is
  /// replaced by the minimum of the last iteration's quadratic problem without bounds on that step.
  Vector2<double> wanted() const;
  /// Root mean square of the position error along the plan [m].
  double error() const;
  const std::vector<State>& states() const { return states_; }  ///< at the start, after each step

 private:
  using Square = Eigen::Matrix<double, kStates, kStates>;
  using Drive = Eigen::Matrix<double, kStates, 2>;
  using Gain = Eigen::Matrix<double, 2, kStates>;
  struct Linear {
    Square A;
    Drive B;
  };

  /// The state after step k of the horizon.
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
