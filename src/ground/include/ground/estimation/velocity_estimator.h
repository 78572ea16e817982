#pragma once

#include <array>
#include <limits>
#include <memory>
#include <string>

#include "ground/estimation/axis_filter.h"
#include "ground/model/types.h"

namespace ground {

/// What an estimator knows after a pose.
struct StateEstimate {
  Vector3<double> eta = Vector3<double>::Zero();     ///< x, y [m], unwrapped psi [rad], world_ned
  Vector3<double> nu = Vector3<double>::Zero();      ///< u, v [m/s], r [rad/s], body
  Vector3<double> nu_dot = Vector3<double>::Zero();  ///< their derivatives by time, body
  Matrix3<double> nu_covariance = Matrix3<double>::Zero();
  bool used = false;        ///< the pose went into the estimate
  bool valid = false;       ///< enough poses have, and the last one did
  const char* status = "";  ///< why not; empty when valid
};

/// How an estimator judges poses, whatever its filter.
struct EstimatorParams {
  double position_noise = 5e-4;  ///< standard deviation of x and y [m]
  double heading_noise = 5e-3;   ///< standard deviation of psi [rad]
  double max_gap = 0.5;          ///< a longer gap starts the filter anew [s]
  double linear_jerk = 8.0;      ///< Kalman: root spectral density of the jerk [m/s^2.5]
  double angular_jerk = 150.0;   ///< Kalman: the same for the heading [rad/s^2.5]
  double gate = 6.0;             ///< Kalman: largest innovation in standard deviations
  int median = 5;                ///< finite differences: velocities in the median, odd

  std::string validate() const;  ///< what is wrong; empty when nothing is
};

/// From poses to velocities, with the poses' own stamps. Repeated and slightly late stamps are
/// ignored; a long gap or a jump back in time starts anew.
class VelocityEstimator {
 public:
  explicit VelocityEstimator(const EstimatorParams& params) : params_(params) {}
  virtual ~VelocityEstimator() = default;

  /// Takes a pose measured at `stamp` [s]; psi may be wrapped.
  const StateEstimate& update(double stamp, const Vector3<double>& eta);
  void reset();
  const StateEstimate& estimate() const { return estimate_; }

 protected:
  /// Starts at a pose.
  virtual void start(const Vector3<double>& eta) = 0;
  /// Takes the next pose, dt [s] > 0 after the last; psi is within pi of the last one's. False
  /// when the pose is not to be believed.
  virtual bool advance(double dt, const Vector3<double>& eta) = 0;
  /// Last heading, to which the next one is unwrapped [rad].
  virtual double heading(double dt) const = 0;

  EstimatorParams params_;
  StateEstimate estimate_;

 private:
  const StateEstimate& ignore(const char* status, bool still_valid);

  double stamp_ = 0;
  int accepted_ = 0, rejected_ = 0;
};

/// The thesis's way: finite differences and a running median.
std::unique_ptr<VelocityEstimator> makeFiniteDifferenceEstimator(const EstimatorParams& params);
/// Constant acceleration driven by white jerk, on position and heading in the world's frame.
std::unique_ptr<VelocityEstimator> makeKalmanEstimator(const EstimatorParams& params);

/// Body velocities and their derivatives from the motion in the world's frame.
void bodyMotion(const Vector3<double>& velocity, const Vector3<double>& acceleration, double psi,
                Vector3<double>& nu, Vector3<double>& nu_dot);

}  // namespace ground
