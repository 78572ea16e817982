#pragma once

#include <string>

#include "ground/model/types.h"

namespace ground {

/// A random wrench that acts in addition to the model, in the body frame: X, Y [N], N [N m]. Each
/// channel is the sum of an Ornstein-Uhlenbeck process, white noise and a constant that differs
/// from run to run. The thrust also differs from run to run. Dynamics does not include the
/// disturbance: simulators and estimators add it.
struct Disturbance {
  /// Stationary standard deviation of the Ornstein-Uhlenbeck process [N, N, N m].
  Vector3<double> sigma = Vector3<double>::Zero();
  /// Correlation time of that process [s]; positive where sigma is positive.
  Vector3<double> time = Vector3<double>::Zero();
  /// Root of the white noise's two-sided spectral density [N sqrt(s), N sqrt(s), N m sqrt(s)].
  Vector3<double> white = Vector3<double>::Zero();
  /// Standard deviation, from run to run, of a constant wrench [N, N, N m].
  Vector3<double> trim = Vector3<double>::Zero();
  /// Standard deviation, from run to run, of a factor on the thrust, whose mean is 1.
  double trim_thrust = 0;

  /// Whether all levels are 0.
  bool empty() const;
  /// Error message, or an empty string if all values are valid.
  std::string validate() const;
};

}  // namespace ground
