#pragma once

#include <optional>

#include "ground/model/dynamics.h"
#include "ground/model/inputs.h"
#include "ground/model/model.h"

namespace ground {

/// Acceleration of a craft at rest by its thrusters, for the fence: rather too large. It is k/m times what
/// the thrusters push at rest, or the acceleration of the whole model, with its effects and the voltage of
/// the battery, if that is larger: an effect may be wrong, so it never makes the acceleration smaller.
///
///     ThrustAcceleration acceleration(model);
///     acceleration.setVoltage(7.9);                                        // whenever the craft reports it
///     const Vector2<double> a = acceleration(drive.since(now), {1, 1, 1});  // full thrust
///
/// Inputs are taken as they are: delay and lag of the actuators are left out, so thrust counts too early.
class ThrustAcceleration {
 public:
  explicit ThrustAcceleration(const Model& model);

  /// The voltage of the battery from now on [V]; implausible values are ignored.
  void setVoltage(double volts);
  /// Body axes [m/s^2]; `t`: time since the drive began [s]; `inputs`: shares of the largest input.
  Vector2<double> operator()(double t, const Inputs& inputs) const;

 private:
  ThrusterLayoutPtr thrusters_;
  double input_max_, push_;  ///< push_: k/m
  double nominal_volts_;     ///< at which k holds [V]; 0: not known
  Dynamics<double> craft_;
  std::optional<double> volts_;  ///< of the battery [V]
};

}  // namespace ground
