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

/// Kalman filter of one coordinate: position, velocity, acceleration, driven by white jerk.
struct AxisFilter {
  Eigen::Vector3d x = Eigen::Vector3d::Zero();
  Eigen::Matrix3d P = Eigen::Matrix3d::Zero();

  /// Starts with a position of variance r and a motion of usual speed.
  void start(double position, double r, double usual_speed);
  /// Time update over dt [s] with the jerk's spectral density q.
  void predict(double dt, double q);
  /// Measurement update by the innovation z - x(i) with variance r.
  void correct(int i, double innovation, double r);
  /// The smoothed state, given that `later`, dt [s] after it: a backward step of Rauch, Tung, Striebel
  /// (1965).
  Eigen::Vector3d smoothed(const Eigen::Vector3d& later, double dt, double q) const;
};

/// The motion of a craft from poses, live and recorded: x, y and psi in the world frame, each with
/// constant acceleration driven by white jerk.
///
/// A pose is rejected if one of its innovations is outside the gate, or if the craft would be faster than
/// params.most. After kMinPoses rejected poses that are consistent with each other the filter is wrong and
/// has to restart. Stamp noise counts as position noise in proportion to the speed.
class MotionFilter {
 public:
  enum class Pose { kStarts, kUsed, kRejected, kJumped };
  static constexpr int kMinPoses = 5;

  /// Adds a pose, with wrapped or unwrapped heading, at a stamp [s] that is not before the last one.
  /// kStarts: the filter starts there, as nothing leads to it. kJumped: it has to start() again.
  Pose add(double stamp, const Vector3<double>& eta, const EstimatorParams& params);
  /// Whether the filter leads to a stamp: it was started, and has no longer gap than params.max_gap.
  bool leadsTo(double stamp, const EstimatorParams& params) const {
    return started_ && stamp - used_stamp_ <= params.max_gap;
  }
  /// Starts at a pose, with its heading unwrapped relative to the last one.
  void start(double stamp, const Vector3<double>& eta, const EstimatorParams& params);
  /// The next pose starts the filter.
  void forget() { started_ = false; }
  void predict(double stamp, const EstimatorParams& params);
  /// Corrects by a measured derivative of an axis, of order 1 or 2, with its standard deviation.
  void correctBy(int axis, int order, double measured, double noise) {
    AxisFilter& filter = axes_[static_cast<std::size_t>(axis)];
    filter.correct(order, measured - filter.x(order), noise * noise);
  }

  /// Covariance of a pose measured now: the noise of x, y and psi, and of the stamp at this velocity.
  Matrix3<double> poseCovariance(const EstimatorParams& params) const;

  /// Innovation of the last pose, used or not, and its expected variance.
  const Vector3<double>& innovation() const { return innovation_; }
  const Vector3<double>& innovationVariance() const { return innovation_variance_; }
  double stamp() const { return stamp_; }           ///< of the state [s]
  double usedStamp() const { return used_stamp_; }  ///< of the last used pose [s]
  const std::array<AxisFilter, 3>& axes() const { return axes_; }
  Vector3<double> position() const { return row(0); }      ///< x, y [m], unwrapped psi [rad]
  Vector3<double> velocity() const { return row(1); }      ///< world frame
  Vector3<double> acceleration() const { return row(2); }  ///< world frame

 private:
  Vector3<double> row(int i) const { return {axes_[0].x(i), axes_[1].x(i), axes_[2].x(i)}; }
  bool correct(const Vector3<double>& eta, const EstimatorParams& params);
  bool contradicted(const Vector3<double>& eta, const EstimatorParams& params);

  std::array<AxisFilter, 3> axes_;
  Vector3<double> innovation_ = Vector3<double>::Zero(), innovation_variance_ = Vector3<double>::Ones();
  double stamp_ = 0, used_stamp_ = 0;
  bool started_ = false;
  // Consecutive rejected poses that are consistent with each other:
  int rejected_ = 0;
  double rejected_stamp_ = 0;
  Vector3<double> rejected_eta_ = Vector3<double>::Zero();
};

/// Body velocities and their time derivatives from the motion in the world frame.
void bodyMotion(const Vector3<double>& velocity, const Vector3<double>& acceleration, double psi,
                Vector3<double>& nu, Vector3<double>& nu_dot);

}  // namespace ground
