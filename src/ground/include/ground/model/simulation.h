#pragma once

#include <optional>
#include <vector>

#include "ground/model/dynamics.h"
#include "ground/model/stepping.h"

namespace ground {

/// Simulates a model under a sequence of commands with the steps of Stepping. T is double or Jet.
/// Dynamics and sequence must outlive it; the sequence may grow.
template <typename T>
class Simulation {
 public:
  /// Starts at time `start` [s] of the sequence's clock, with the states of effects settled to the
  /// earlier commands and to the motion measured before, or to the initial state if none is given
  /// (Dynamics::settle). Steps are at most max_step [s] long.
  Simulation(const Dynamics<T>& dynamics, const InputSequence& inputs, const RigidState<T>& initial,
             double start, double max_step = kDefaultStep, const Motion* measured = nullptr);

  /// From now on only velocities are integrated; for models whose velocities do not depend on the
  /// pose (Dynamics::usesPose).
  void forgetPose() { pose_ = false; }

  /// Integrates to `time` [s]; times before the current one are an error (std::invalid_argument).
  void advance(double time);

  /// Call after InputSequence::dropBefore(). The dropped commands must no longer act.
  void forget(std::size_t count) {
    stepping_.forget(count);
    acts_ = kNone;
  }

  double time() const { return stepping_.time(); }
  const RigidState<T>& state() const { return state_; }
  RigidState<T>& state() { return state_; }
  /// Continues from another state. Keeps the values of the effects' states, not their derivatives.
  void restart(const RigidState<T>& state);
  /// Acceleration and velocity at the current time.
  RigidState<T> derivative() const;
  /// Thruster inputs after the actuators, at the current time.
  Thrusters<T> actuated() const;
  Measurement<T> measure() const {
    if (dynamics_.distorts()) return dynamics_.measure(state_);
    return {state_.eta, state_.nu};
  }

 private:
  template <typename H>
  void step(int steps, const H& h);
  Conditions<T> conditionsAt(double time) const {
    const Conditions<double> now = stepping_.conditionsAt(time);
    return {now.lift, now.volts};
  }

  const Dynamics<T>& dynamics_;
  Stepping stepping_;
  RigidState<T> state_;
  std::vector<T> effect_states_;
  T t_;  ///< time since the drive began [s]
  bool pose_ = true;

  static constexpr std::size_t kNone = -1;
  /// Without memory: the same for all steps under a command.
  std::optional<StepInputs<T>> acting_;
  std::size_t acts_ = kNone;  ///< Stepping::held() of it
};

extern template class Simulation<double>;
extern template class Simulation<Jet>;

/// Means of what reaches the craft between ascending times [s], which the motion does not change: thruster
/// inputs after the actuators, and the lift, a row for each interval.
Eigen::MatrixXd meanInputs(const Dynamics<double>& dynamics, const InputSequence& inputs,
                           const std::vector<double>& times);

}  // namespace ground
