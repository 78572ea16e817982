#pragma once

#include <optional>

#include "ground/model/dynamics.h"
#include "ground/model/inputs.h"
#include "ground/model/model.h"

namespace ground {

/// Acceleration of a craft at rest by its thrusters, for the fence: rather too large. It is k/m times what
/// the thrusters push at rest, or the acceleration of the whole model, with its effects and the voltage of
/// the battery, if that is larger: an effect may be wrong, so it never makes the acceleration smaller.
class ThrustAcceleration {
 public:
  explicit ThrustAcceleration(const Model& model);

  /// The voltage of the battery from now on [V]; implausible values are ignored.
  void setVoltage(double volts);
  /// Body axes [m/s^2]; `inputs`: shares of the largest input.
  Vector2<double> operator()(const Inputs& inputs) const;

 private:
  ThrusterLayoutPtr thrusters_;
  double input_max_, push_;  ///< push_: k/m
  double nominal_volts_;     ///< at which k holds [V]; 0: not known
  Dynamics<double> craft_;
  std::optional<double> volts_;  ///< of the battery [V]
};

}  // namespace ground
