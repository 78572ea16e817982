#pragma once

#include <array>
#include <cstddef>
#include <limits>

#include "ground/model/pushed_step.h"
#include "ground/parameters/ObserverParams.h"

namespace ground {

/// Noise levels of the observer; spectral densities are square roots of one-sided ones.
/// Estimates pose, velocity and missing acceleration from measured poses and given commands: an
/// extended Kalman filter with the craft's model and the missing acceleration as a random walk in
/// the body frame.
///
/// It applies the model's input delay and simulates the states of its effects, without correcting
/// them. It can therefore predict the state at the time when a command given now will act. It
/// allocates no memory after construction.
class DisturbanceObserver {
 public:
  struct Estimate {
    RigidState<double> state;
    std::array<double, kMaxStates> effects{};           ///< states of the model's effects
    Vector3<double> missing = Vector3<double>::Zero();  ///< body [m/s^2, m/s^2, rad/s^2]
  };

  /// Throws std::invalid_argument if the model's effects have more than kMaxStates states.
  DisturbanceObserver(const Model& model, const ObserverParams& params);

  void setParams(const ObserverParams& params) { params_ = params; }
  /// Discards all measurements. The commands still act.
  void reset();
  /// Sets the time at which the drive began [s]; the model's t is 0 until then.
  void countFrom(double origin) { origin_ = origin; }
  /// Adds a command, in the model's units, given at `time` [s]. If it is earlier than the previous
  /// one, time has jumped back, and all earlier commands are discarded.
  void command(double time, const Thrusters<double>& thrusters, double lift);
  /// The voltage of the battery from now on [V].
  void voltage(double volts) { volts_ = volts; }
  /// Adds a measurement at `time`. Velocities are used only at a restart. Measurements that are not
  /// newer than the last one are ignored.
  void measure(double time, const RigidState<double>& measured);
  /// The estimate at `time`, which must not be before the last measurement.
  Estimate at(double time) const;
  /// Covariance of the last estimate's eta, nu and missing acceleration that the noise of the poses alone
  /// causes when the model is right.
  const Eigen::Matrix<double, 9, 9>& noise() const { return noise_; }
  /// Derivatives of eta, nu at the last measurement by those at the one before; the identity after a restart.
  const Eigen::Matrix<double, 6, 6>& transition() const { return transition_; }
  /// Input delay of the model [s].
  double delay() const { return dynamics_.inputDelay(); }

 private:
  using Vector9 = Eigen::Matrix<double, 9, 1>;
  using Matrix9 = Eigen::Matrix<double, 9, 9>;
  struct Command {
    double time = 0;
    Thrusters<double> thrusters;
    double lift = 0;
  };

  /// Computes the states of effects at the last measurement from the commands before it.
  void settle();
  void begin(double time, const RigidState<double>& measured);
  const Command& recent(std::size_t age) const;
  /// Calls step(h, command) for each interval of `from`..`until` with a constant command.
  template <typename Step>
  void replay(double from, double until, Step step) const;
  void predict(double until);
  void correct(const Vector3<double>& eta);

  Dynamics<double> dynamics_;
  Dynamics<Jet> derivatives_;
  ObserverParams params_;
  std::array<Command, 128> commands_;  ///< ring buffer
  std::size_t count_ = 0;              ///< total number of commands
  double volts_ = 0;                   ///< of the battery [V]; 0: not known
  bool started_ = false;
  double time_ = 0;                                          ///< time of the last measurement [s]
  double origin_ = std::numeric_limits<double>::infinity();  ///< start of the drive [s]
  Estimate estimate_;
  Matrix9 covariance_;  ///< covariance of eta, nu, missing
  Matrix9 noise_;       ///< its part that the noise of the poses causes
  Eigen::Matrix<double, 6, 6> transition_;
};

}  // namespace ground
