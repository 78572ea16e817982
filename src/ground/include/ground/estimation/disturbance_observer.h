#pragma once

#include <array>
#include <cstddef>
#include <limits>
#include <optional>

#include "ground/model/pose_measurement.h"
#include "ground/model/pushed_step.h"
#include "ground/parameters/ObserverParams.h"

namespace ground {

/// Estimates pose, velocity and missing acceleration from measured poses and given commands: an
/// extended Kalman filter with the craft's model and the missing acceleration as a random walk in
/// the body frame.
///
/// It takes poses as the mocap gives them, with their covariance. Gyro and accelerometer, where there are
/// any, measure the yaw rate, and the acceleration since the last pose, whose random part is also part of
/// the motion.
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
  /// The voltage of the battery from now on [V]; no value: not known.
  void voltage(std::optional<double> volts) { volts_ = volts; }
  /// Adds a measurement at `time`. The filtered `state` is used only at a restart. Measurements that are not
  /// newer than the last one, or have no pose, are ignored.
  void measure(double time, const RigidState<double>& state, const PoseMeasurement& measured);
  /// Whether there is an estimate.
  bool started() const { return started_; }
  /// The estimate at `time`, which must not be before the last measurement.
  Estimate at(double time) const;
  /// Covariance of the last estimate's eta, nu and missing acceleration that the noise of the poses alone
  /// causes when the model is right.
  Eigen::Matrix<double, 9, 9> noise() const { return noise_.topLeftCorner<9, 9>(); }
  /// Derivatives of eta, nu at the last measurement by those at the one before; the identity after a restart.
  const Eigen::Matrix<double, 6, 6>& transition() const { return transition_; }
  /// Input delay of the model [s].
  double delay() const { return dynamics_.inputDelay(); }

 private:
  /// Of eta, nu, missing, and the biases of the sensors.
  static constexpr int kStates = 12;
  using Vector = Eigen::Matrix<double, kStates, 1>;
  using Matrix = Eigen::Matrix<double, kStates, kStates>;
  using Gain = Eigen::Matrix<double, kStates, 3>;
  struct Command {
    double time = 0;
    Thrusters<double> thrusters;
    double lift = 0;
  };

  /// Velocity of the tracked point, which poses and sensors measure, and its derivatives by nu.
  struct Velocity {
    Vector3<double> value;
    Matrix3<double> by_nu;
  };

  /// Computes the states of effects at the last measurement from the commands before it.
  void settle();
  void begin(double time, const RigidState<double>& state, const PoseMeasurement& measured);
  const Command& recent(std::size_t age) const;
  /// Calls step(h, command) for each interval of `from`..`until` with a constant command.
  template <typename Step>
  void replay(double from, double until, Step step) const;
  void predict(double until, const std::optional<InertialMeasurement>& inertial);
  Velocity velocity(const RigidState<double>& at) const;
  void feel(const InertialMeasurement& measured, const Velocity& before, double h, const Matrix& F,
            const Vector& noise);
  void apply(const Vector& change);
  void correct(const PoseMeasurement& measured);

  Dynamics<double> dynamics_;
  Dynamics<Jet> derivatives_;
  ObserverParams params_;
  std::array<Command, 128> commands_;  ///< ring buffer
  std::size_t count_ = 0;              ///< total number of commands
  std::optional<double> volts_;        ///< of the battery [V]
  bool started_ = false;
  double time_ = 0;                                          ///< time of the last measurement [s]
  double origin_ = std::numeric_limits<double>::infinity();  ///< start of the drive [s]
  Estimate estimate_;
  Vector3<double> bias_;  ///< of accelerometer and gyro [m/s^2, m/s^2, rad/s]
  Matrix covariance_;
  Matrix noise_;  ///< its part that the noise of the poses causes
  Eigen::Matrix<double, 6, 6> transition_;
};

}  // namespace ground
