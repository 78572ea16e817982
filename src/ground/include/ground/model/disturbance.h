#pragma once

#include <string>

#include "ground/model/types.h"

namespace ground {

/// A random wrench beside the model, in the body's frame: X, Y [N], N [N m]. In each channel it is
/// the sum of an Ornstein-Uhlenbeck process, white noise and a constant that differs from run to
/// run; the thrust differs from run to run, too. Dynamics leaves it out: whoever simulates or
/// estimates adds it.
struct Disturbance {
  /// Stationary standard deviation of the Ornstein-Uhlenbeck process [N, N, N m].
  Vector3<double> sigma = Vector3<double>::Zero();
  /// Its correlation time [s]; positive where sigma is.
  Vector3<double> time = Vector3<double>::Zero();
  /// Root of the white noise's two-sided spectral density [N sqrt(s), N sqrt(s), N m sqrt(s)].
  Vector3<double> white = Vector3<double>::Zero();
  /// Standard deviation, from run to run, of a constant wrench [N, N, N m].
  Vector3<double> trim = Vector3<double>::Zero();
  /// Standard deviation, from run to run, of a factor on the thrust, whose mean is 1.
  double trim_thrust = 0;

  /// Whether there is none.
  bool empty() const;
  /// Says what is wrong; empty when nothing is.
  std::string validate() const;
};

}  // namespace ground
