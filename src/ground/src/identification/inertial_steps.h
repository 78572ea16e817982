// What a gyro and an accelerometer measure over the steps between poses.
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <cstddef>

#include "ground/identification/run_data.h"

namespace ground::detail {

/// Errors of sensors that stay the same during a run: delay [s]; bias [rad/s] and scale of the gyro; biases
/// [m/s^2] and scale of the accelerometer, its mounting [rad] and place [m].
constexpr int kSensorErrors = 9;
using SensorRows = Eigen::Matrix<double, 3, kSensorErrors>;
using SensorVector = Eigen::Matrix<double, kSensorErrors, 1>;

/// Standard deviations of these errors about the calibration. The prior is broad, because the same
/// measurements calibrate: the likelihood finds the errors anew, with what is certain about them.
SensorVector sensorDeviations();

/// Means of inertial samples over the steps that end at the samples of a run, and their noise; a row is
/// NaN where a step has none. Without rows: the run has nothing inertial.
struct InertialSteps {
  Eigen::MatrixX3d mean, noise;

  explicit InertialSteps(const RunData& run);

  bool has(std::size_t sample) const { return !std::isnan(mean(static_cast<Eigen::Index>(sample), 0)); }
};

/// Derivative of the means over a step by the sensors' errors. expected: the means; rate: their mean
/// derivative by time. Both are expected from what was measured before: the numbers themselves have the
/// disturbance of the step, with which the errors would be correlated.
SensorRows byErrors(const Vector3<double>& expected, const Vector3<double>& rate);

/// Mean yaw rate and specific force ahead and to starboard at a place of the craft, between two measured
/// motions dt [s] apart.
template <typename T>
Vector3<T> inertialBetween(const Measurement<T>& from, const Measurement<T>& to, double dt,
                           const Vector2<double>& place) {
  const auto velocity = [&](const Measurement<T>& at) {
    return Vector2<T>(at.nu(0) - at.nu(2) * place.y(), at.nu(1) + at.nu(2) * place.x());
  };
  const Vector2<T> first = velocity(from), last = velocity(to);
  const T half(0.5);
  return {(to.eta(2) - from.eta(2)) / dt,
          (last.x() - first.x()) / dt - half * (first.y() * from.nu(2) + last.y() * to.nu(2)),
          (last.y() - first.y()) / dt + half * (first.x() * from.nu(2) + last.x() * to.nu(2))};
}

}  // namespace ground::detail
