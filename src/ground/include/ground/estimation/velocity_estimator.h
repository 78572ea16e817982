#pragma once

#include <memory>

#include "ground/estimation/motion_filter.h"
#include "ground/model/types.h"

namespace ground {

/// What an estimator knows after a pose.
struct StateEstimate {
  Vector3<double> eta = Vector3<double>::Zero();     ///< x, y [m], unwrapped psi [rad], world_ned
  Vector3<double> nu = Vector3<double>::Zero();      ///< u, v [m/s], r [rad/s], body
  Vector3<double> nu_dot = Vector3<double>::Zero();  ///< their derivatives by time, body
  Matrix3<double> eta_covariance = Matrix3<double>::Zero();
  Matrix3<double> nu_covariance = Matrix3<double>::Zero();
  bool used = false;                   ///< the pose went into the estimate
  bool ignored = false;                ///< the pose said nothing new: its stamp is repeated or late
  bool valid = false;                  ///< enough poses went in, and not too many in a row did not
  const char* status = "no pose yet";  ///< why not used, or why not valid; empty when all is well
};

/// From poses to velocities, with the poses' own stamps. Repeated and slightly late stamps are
/// ignored; a long gap or a jump back in time starts anew. Single poses that cannot be (spikes,
/// turned headings, no number) are left out; the estimate stays valid over three of them, each of
/// which the next good pose makes up for, and starts anew after five in a row that follow from each
/// other. Stamps are taken to be as inexact as the
/// scatter of their intervals, or params.stamp_noise if that is more. No allocation after
/// construction.
class VelocityEstimator {
 public:
  virtual ~VelocityEstimator() = default;

  /// Takes a pose measured at `stamp` [s], x, y [m], psi [rad] in world_ned; psi may be wrapped.
  const StateEstimate& update(double stamp, const Vector3<double>& eta);
  /// Notes a pose that cannot be used; `why` must outlive the estimator.
  const StateEstimate& reject(const char* why);
  /// Forgets all.
  void reset();
  /// Takes effect with the next pose, without a new start.
  void setParams(const EstimatorParams& params) { given_ = params; }
  const StateEstimate& estimate() const { return estimate_; }

 protected:
  explicit VelocityEstimator(const EstimatorParams& params) : params_(params), given_(params) {}

  /// Starts at a pose; its heading is unwrapped to the estimate's.
  virtual void start(const Vector3<double>& eta) = 0;
  /// Takes the next pose, dt [s] > 0 after the last one; false when it is not to be believed.
  virtual bool advance(double dt, const Vector3<double>& eta) = 0;

  EstimatorParams params_;  ///< with the stamp noise that holds now
  StateEstimate estimate_;

 private:
  EstimatorParams given_;
  IntervalScatter scatter_;
  double stamp_ = 0;       ///< of the last pose, believed or not [s]
  double used_stamp_ = 0;  ///< of the last pose that went in [s]
  int accepted_ = 0;       ///< poses that went in since the start
  int rejected_ = 0;       ///< poses that did not, less those that did since
  JumpDetector jump_;
};

/// The thesis's way (3.3.3): finite differences and a running median.
std::unique_ptr<VelocityEstimator> makeFiniteDifferenceEstimator(const EstimatorParams& params);
/// Kalman filter of MotionFilter's model.
std::unique_ptr<VelocityEstimator> makeKalmanEstimator(const EstimatorParams& params);

/// Body velocities and their derivatives from the motion in the world's frame.
void bodyMotion(const Vector3<double>& velocity, const Vector3<double>& acceleration, double psi,
                Vector3<double>& nu, Vector3<double>& nu_dot);

}  // namespace ground
