#pragma once

#include <cstddef>
#include <vector>

#include "ground/model/dynamics.h"

namespace ground {

/// Commands over time, each held until the next; thrusters and lift are off before the first.
struct InputSequence {
  std::vector<double> times;               ///< ascending, on the run's clock [s]
  std::vector<Vector2<double>> thrusters;  ///< left, right
  std::vector<double> lift;

  void add(double time, double left, double right, double lift);
  std::size_t size() const { return times.size(); }
};

/// Runs a model through a sequence of commands. Steps end exactly at the instants asked for and at
/// the instants where the (delayed) command changes, so that RK4 keeps its order and derivatives
/// by the delay are exact. Dynamics and sequence must outlive it; the sequence may grow.
template <typename T>
class Simulation {
 public:
  /// Starts at time `start` [s] of the sequence's clock with actuators settled to the commands
  /// given until then. Steps are at most max_step [s] long.
  Simulation(const Dynamics<T>& dynamics, const InputSequence& inputs, const RigidState<T>& initial,
             double start, double max_step = kDefaultStep);

  /// From now on only velocities are integrated; for models whose velocities do not depend on the
  /// pose (Dynamics::usesPose).
  void forgetPose() { pose_ = false; }

  /// Integrates to `time` [s]; times before the current one are an error (std::invalid_argument).
  void advance(double time);

  double time() const { return valueOf(time_); }
  const RigidState<T>& state() const { return state_; }
  RigidState<T>& state() { return state_; }
  /// Acceleration and velocity at the current time.
  RigidState<T> derivative() const;
  /// What reaches the thrusters at the current time.
  Vector2<T> actuated() const;
  Measurement<T> measure() const { return dynamics_.measure(state_); }

  static constexpr double kDefaultStep = 0.005;  ///< thesis 2.3

 private:
  Vector2<T> command() const;
  double lift() const;
  void advanceHeld(const T& until);
  template <bool kPose, typename H>
  void step(int steps, const H& h);

  const Dynamics<T>& dynamics_;
  const InputSequence& inputs_;
  RigidState<T> state_;
  std::vector<T> actuator_states_;
  T time_;
  std::size_t next_ = 0;  ///< first command that has not taken effect
  double max_step_;
  bool pose_ = true;
};

extern template class Simulation<double>;
extern template class Simulation<Jet>;

}  // namespace ground
