#pragma once

#include <Eigen/Core>

namespace ground {

/// Kalman filter of one coordinate: position, velocity, acceleration, driven by white jerk.
struct AxisFilter {
  Eigen::Vector3d x = Eigen::Vector3d::Zero();
  Eigen::Matrix3d P = Eigen::Matrix3d::Zero();

  /// Knows the position with variance r and nothing of the motion but its typical size.
  void reset(double position, double r, double velocity_variance, double acceleration_variance);
  /// Time update over dt [s] with the jerk's spectral density q.
  void predict(double dt, double q);
  /// Measurement update by the innovation z - x(0) with variance r.
  void correct(double innovation, double r);

  static Eigen::Matrix3d transition(double dt);
};

}  // namespace ground
