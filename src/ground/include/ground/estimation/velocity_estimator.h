#pragma once

#include <algorithm>

#include "ground/estimation/inertial_fusion.h"
#include "ground/estimation/motion_filter.h"
#include "ground/model/types.h"

namespace ground {

/// Estimate after a pose.
struct StateEstimate {
  Vector3<double> eta = Vector3<double>::Zero();     ///< x, y [m], unwrapped psi [rad], world_ned
  Vector3<double> nu = Vector3<double>::Zero();      ///< u, v [m/s], r [rad/s], body
  Vector3<double> nu_dot = Vector3<double>::Zero();  ///< time derivatives of nu, body
  Matrix3<double> eta_covariance = Matrix3<double>::Zero();
  Matrix3<double> nu_covariance = Matrix3<double>::Zero();
  /// The pose itself, if it was used, and what the sensors measured since the last one.
  PoseMeasurement pose;
  bool used = false;                   ///< the pose was used
  bool ignored = false;                ///< the pose was ignored: its stamp is repeated or late
  bool valid = false;                  ///< enough poses were used, few enough rejected
  const char* status = "no pose yet";  ///< why not used, or why not valid; empty if valid
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

/// How much larger the innovations of a filter are than it expects: the running mean of the normalised
/// innovation squared, y^2 / S for an innovation y of variance S; 1 if poses are as noisy as assumed.
class InnovationScatter {
 public:
  void add(const MotionFilter& filter);
  /// Factor of the variances of x and y (axes 0, 1) or psi (axis 2), at least 1.
  double excess(int axis) const { return std::max(1.0, axis < 2 ? position_ : heading_); }

 private:
  static constexpr int kMemory = 200;  // poses

  int count_ = 0;
  double position_ = 1, heading_ = 1;
};

/// Estimates velocities from poses and their stamps by a Kalman filter of MotionFilter's model.
///
/// Ignores repeated and slightly late stamps; restarts after a long gap or a jump back in time.
/// Rejects impossible poses (spikes, flipped headings, NaN). The estimate stays valid over up to
/// three rejected poses, a count that each accepted pose lowers by one. It restarts after five
/// consecutive rejected poses that are consistent with each other. The noise of stamps is the
/// scatter of their intervals, or params.stamp_noise if that is larger. Covariances grow where poses scatter
/// more than params say. No allocation after construction.
class VelocityEstimator {
 public:
  explicit VelocityEstimator(const EstimatorParams& params) : params_(params), given_(params) {}

  /// Adds a pose measured at `stamp` [s], x, y [m], psi [rad] in world_ned; psi may be wrapped.
  const StateEstimate& update(double stamp, const Vector3<double>& eta);
  /// Counts a pose that cannot be used; `why` must outlive the estimator.
  const StateEstimate& reject(const char* why);
  /// Discards all poses.
  void reset();
  /// Takes effect with the next pose, without a restart.
  void setParams(const EstimatorParams& params) { given_ = params; }
  /// The craft's sensors, which make velocities better but never valid; see InertialFusion.
  InertialFusion& inertial() { return inertial_; }
  const StateEstimate& estimate() const { return estimate_; }
  const InnovationScatter& innovations() const { return innovations_; }

 private:
  void publish(const MotionFilter& motion);
  /// The filter to publish after filter_ was corrected by a pose.
  const MotionFilter& withSensors(double stamp, const Vector3<double>& eta);

  EstimatorParams params_;  ///< with the current stamp noise
  StateEstimate estimate_;
  EstimatorParams given_;
  IntervalScatter scatter_;
  InnovationScatter innovations_;
  int accepted_ = 0;  ///< number of used poses since the start
  int rejected_ = 0;  ///< number of rejected poses minus those used since; at least 0
  MotionFilter filter_;
  InertialFusion inertial_;
};

}  // namespace ground
