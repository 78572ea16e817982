#pragma once

#include <limits>
#include <optional>

#include "ground/model/types.h"

namespace ground {

/// What gyro and accelerometer measure up to a pose, with their biases.
struct InertialMeasurement {
  Vector2<double> acceleration;  ///< of the tracked point ahead and to starboard, mean over `span` [m/s^2]
  double yaw_rate = 0;           ///< at the pose [rad/s]
  Vector3<double> variance;      ///< of these three
  double span = 0;               ///< time since the pose before [s]
};

/// What is measured at a stamp, before any filter: its errors are independent of the errors at other stamps.
/// Filters with the craft's model use it instead of the filtered state, whose errors are not.
struct PoseMeasurement {
  /// x, y [m], psi [rad], which may be wrapped, world_ned; NaN: no pose.
  Vector3<double> eta = Vector3<double>::Constant(std::numeric_limits<double>::quiet_NaN());
  Matrix3<double> covariance = Matrix3<double>::Zero();
  std::optional<InertialMeasurement> inertial;  ///< no value: not measured
};

/// A pose with these standard deviations of x and y [m] and of the heading [rad].
inline PoseMeasurement poseMeasurement(const Vector3<double>& eta, double position_noise,
                                       double heading_noise) {
  PoseMeasurement measured;
  measured.eta = eta;
  measured.covariance.diagonal() << position_noise * position_noise, position_noise * position_noise,
      heading_noise * heading_noise;
  return measured;
}

}  // namespace ground
