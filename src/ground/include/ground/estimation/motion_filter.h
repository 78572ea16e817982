#pragma once

#include <Eigen/Core>
#include <array>
#include <limits>
#include <string>

#include "ground/model/types.h"
#include "ground/parameters/EstimatorFields.h"

namespace ground {

/// Parameters of all velocity estimators.
struct EstimatorParams : EstimatorFields {
  double linear_speed = 3.0;    ///< usual speed of the craft: initial uncertainty of the filter [m/s]
  double angular_speed = 20.0;  ///< usual yaw rate [rad/s]
  double most = std::numeric_limits<double>::infinity();  ///< largest velocity [usual ones]

  /// Standard deviation of x and y (axes 0, 1) [m] or psi (axis 2) [rad].
  double noise(int axis) const { return axis < 2 ? position_noise : heading_noise; }
  double jerk(int axis) const { return axis < 2 ? linear_jerk : angular_jerk; }
  double speed(int axis) const { return axis < 2 ? linear_speed : angular_speed; }
};

/// Whether a craft can move from one pose to the next within dt [s] at up to `times` its usual
/// speed. Headings are compared as angles.
bool sameMotion(const Vector3<double>& from, const Vector3<double>& to, double dt, double times,
                const EstimatorParams& params);

/// Largest speed of a craft with unknown motion, as a multiple of the usual speed.
constexpr double kUnknownMotion = 3.0;

/// Kalman filter of one coordinate: position, velocity, acceleration, driven by white jerk.
struct AxisFilter {
  Eigen::Vector3d x = Eigen::Vector3d::Zero();
  Eigen::Matrix3d P = Eigen::Matrix3d::Zero();

  /// Starts with a position of variance r and a motion of usual speed.
  void start(double position, double r, double usual_speed);
  /// Time update over dt [s] with the jerk's spectral density q.
  void predict(double dt, double q);
  /// Measurement update by the innovation z - x(0) with variance r.
  void correct(double innovation, double r);
  /// The same for a measured x(i).
  void correct(int i, double innovation, double r);

  static Eigen::Matrix3d transition(double dt);
};

/// The model that the Kalman estimator and the smoother share: x, y and psi in the world's frame,
/// each with constant acceleration driven by white jerk.
class MotionFilter {
 public:
  /// Starts at a pose, with its heading unwrapped relative to the last one.
  void start(const Vector3<double>& eta, const EstimatorParams& params);
  void predict(double dt, const EstimatorParams& params);
  /// Corrects by a pose, with wrapped or unwrapped heading, unless one of its innovations is outside
  /// the gate or the craft would be faster than params.most; returns whether it did. Stamp noise
  /// counts as position noise in proportion to the speed.
  bool correct(const Vector3<double>& eta, const EstimatorParams& params);
  /// Corrects by a measured derivative of an axis, of order 1 or 2, with its standard deviation.
  void correctBy(int axis, int order, double measured, double noise) {
    AxisFilter& filter = axes_[static_cast<std::size_t>(axis)];
    filter.correct(order, measured - filter.x(order), noise * noise);
  }

  /// Covariance of a pose measured now: the noise of x, y and psi, and of the stamp at this velocity.
  Matrix3<double> poseCovariance(const EstimatorParams& params) const;

  const AxisFilter& axis(int i) const { return axes_[i]; }
  Vector3<double> position() const { return row(0); }      ///< x, y [m], unwrapped psi [rad]
  Vector3<double> velocity() const { return row(1); }      ///< world frame
  Vector3<double> acceleration() const { return row(2); }  ///< world frame

 private:
  Vector3<double> row(int i) const { return {axes_[0].x(i), axes_[1].x(i), axes_[2].x(i)}; }

  std::array<AxisFilter, 3> axes_;
};

/// Estimates the noise of stamps from the scatter of the intervals between them. Cameras expose at
/// a constant rate, but a client that polls them stamps a frame when it fetches it.
class IntervalScatter {
 public:
  void add(double dt);
  /// Standard deviation of one stamp [s].
  double stampNoise() const;

 private:
  static constexpr int kFirst = 20;    // intervals that are all accepted
  static constexpr int kMemory = 200;  // intervals
  static constexpr double kGap = 1.7;  // relative to the mean; longer intervals have lost frames

  int count_ = 0;
  double mean_ = 0, variance_ = 0;  // [s], [s^2]
};

/// Counts consecutive poses that the filter rejected but that are consistent with each other. After
/// kMinPoses of them, the filter is wrong and has to restart.
class JumpDetector {
 public:
  void clear() { count_ = 0; }
  /// Adds a rejected pose at `stamp` [s]; returns whether the filter has to restart.
  bool add(double stamp, const Vector3<double>& eta, const EstimatorParams& params);

  static constexpr int kMinPoses = 5;

 private:
  int count_ = 0;
  double stamp_ = 0;
  Vector3<double> eta_ = Vector3<double>::Zero();
};

}  // namespace ground
