#pragma once

#include <array>
#include <cstddef>
#include <limits>

#include "ground/model/pushed_step.h"
#include "ground/model/tunable.h"

namespace ground {

/// Noise that the observer reckons with; spectral densities are one-sided roots.
struct ObserverParams {
  double position_noise = 3e-4;  ///< of the measured x, y, 1 sigma [m]
  double heading_noise = 5e-3;   ///< of the measured psi, 1 sigma [rad]
  double push = 0.02;            ///< white acceleration, surge and sway [m/s^2/sqrt(Hz)]
  double twist = 0.5;            ///< white acceleration, yaw [rad/s^2/sqrt(Hz)]
  double push_drift = 0.1;       ///< of the missing acceleration, surge and sway [m/s^2/sqrt(s)]
  double twist_drift = 1.0;      ///< the same, yaw [rad/s^2/sqrt(s)]
  double max_gap = 1.0;          ///< between measurements, beyond which it starts anew [s]

  static const Tunables<ObserverParams>& table();  ///< all but max_gap
};

/// Pose, velocity and the missing acceleration, from measured poses and from the
/// commands that were given: an extended Kalman filter around the craft's own model, the missing
/// acceleration a random walk in the body frame. Knows the model's delay and the states of its
/// effects, which it follows but does not correct, so that it also predicts the state at which a
/// command of now will act. Nothing is allocated after construction.
class DisturbanceObserver {
 public:
  struct Estimate {
    RigidState<double> state;
    std::array<double, kMostStates> effects{};           ///< states of the model's effects
    Vector3<double> missing = Vector3<double>::Zero();  ///< body [m/s^2, m/s^2, rad/s^2]
  };

  /// Throws std::invalid_argument when the model's effects have more than kMostStates states.
  DisturbanceObserver(const Model& model, const ObserverParams& params);

  void setParams(const ObserverParams& params) { params_ = params; }
  /// Forgets what was measured; the commands given still act.
  void reset();
  /// The model's t is 0 at `origin` [s], when the drive began, and before it.
  void countFrom(double origin) { origin_ = origin; }
  /// A command, in the model's units, that was given at `time` [s]; one before the last means that
  /// time has jumped back, and those before it are forgotten.
  void command(double time, const Vector2<double>& thrusters, double lift);
  /// What was measured at `time`; velocities are only looked at when it starts anew. Measurements
  /// that are not newer than the last one are left out.
  void measure(double time, const RigidState<double>& measured);
  /// The estimate at `time`, at the last measurement or later.
  Estimate at(double time) const;
  /// Of the model's input [s].
  double delay() const { return dynamics_.inputDelay(); }

 private:
  using Vector9 = Eigen::Matrix<double, 9, 1>;
  using Matrix9 = Eigen::Matrix<double, 9, 9>;
  struct Command {
    double time = 0;
    Vector2<double> thrusters = Vector2<double>::Zero();
    double lift = 0;
  };

  /// The states of effects at the last measurement, from the commands before it.
  void settle();
  void begin(double time, const RigidState<double>& measured);
  const Command& recent(std::size_t age) const;
  /// Calls step(h, command) for the pieces of `from`..`until` over which the command is held.
  template <typename Step>
  void replay(double from, double until, Step step) const;
  void predict(double until);
  void correct(const Vector3<double>& eta);

  Dynamics<double> dynamics_;
  Dynamics<Jet> derivatives_;
  ObserverParams params_;
  std::array<Command, 128> commands_;  ///< a ring
  std::size_t count_ = 0;              ///< of commands ever given
  bool started_ = false;
  double time_ = 0;                                          ///< of the last measurement [s]
  double origin_ = std::numeric_limits<double>::infinity();  ///< of the model's t [s]
  Estimate estimate_;
  Matrix9 covariance_;  ///< of eta, nu, missing
};

}  // namespace ground
