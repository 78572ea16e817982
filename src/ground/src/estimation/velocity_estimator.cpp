#include "ground/estimation/velocity_estimator.h"

#include <algorithm>
#include <cmath>

namespace ground {
namespace {

constexpr int kMinAccepted = 5;        // number of poses after which an estimate is valid
constexpr int kMaxRejected = 3;        // largest count of rejected poses of a valid estimate
constexpr double kBackwardJump = 1.0;  // an earlier stamp than this means that time jumped [s]

}  // namespace

void VelocityEstimator::publish(const MotionFilter& motion) {
  estimate_.eta = motion.position();
  bodyMotion(motion.velocity(), motion.acceleration(), estimate_.eta.z(), estimate_.nu, estimate_.nu_dot);
  // A heading error rotates the velocity: (u, v) += (v, -u) d psi.
  const Vector2<double> turned(estimate_.nu.y(), -estimate_.nu.x());
  const Eigen::Matrix3d &x = motion.axis(0).P, &y = motion.axis(1).P, &psi = motion.axis(2).P;
  estimate_.eta_covariance.diagonal() << x(0, 0), y(0, 0), psi(0, 0);
  Matrix3<double>& C = estimate_.nu_covariance;
  // x and y have the same model and noise, so rotation into the body frame preserves their mean.
  C.topLeftCorner<2, 2>() = psi(0, 0) * turned * turned.transpose();
  C.diagonal().head<2>().array() += 0.5 * (x(1, 1) + y(1, 1));
  C.topRightCorner<2, 1>() = psi(0, 1) * turned;
  C.bottomLeftCorner<1, 2>() = psi(0, 1) * turned.transpose();
  C(2, 2) = psi(1, 1);
}

void bodyMotion(const Vector3<double>& velocity, const Vector3<double>& acceleration, double psi,
                Vector3<double>& nu, Vector3<double>& nu_dot) {
  const Vector2<double> v = velocity.head<2>(), a = acceleration.head<2>();
  nu << worldToBody<double>(psi, v), velocity.z();
  // d/dt (R' v) = R' a - r S R' v
  nu_dot << worldToBody<double>(psi, a) + nu.z() * Vector2<double>(nu.y(), -nu.x()), acceleration.z();
}

const MotionFilter& VelocityEstimator::withSensors(double stamp, const Vector3<double>& eta) {
  inertial_.update(stamp, eta, filter_, params_);
  return inertial_.agrees() ? inertial_.motion() : filter_;
}

void VelocityEstimator::reset() {
  accepted_ = rejected_ = 0;
  jump_.clear();
  inertial_.restart();
  estimate_ = StateEstimate();
}

const StateEstimate& VelocityEstimator::reject(const char* why) {
  estimate_.used = estimate_.ignored = false;
  estimate_.pose = PoseMeasurement();
  rejected_ = std::min(rejected_ + 1, kMaxRejected + 1);
  estimate_.valid = estimate_.valid && rejected_ <= kMaxRejected;
  estimate_.status = why;
  return estimate_;
}

const StateEstimate& VelocityEstimator::update(double stamp, const Vector3<double>& eta) {
  if (!std::isfinite(stamp) || !eta.allFinite()) return reject("the pose is not finite");
  const double dt = stamp - stamp_;
  bool fresh = accepted_ == 0 || stamp - used_stamp_ > params_.max_gap || dt < -kBackwardJump;
  if (!fresh && dt <= 0) {
    estimate_.used = false;
    estimate_.ignored = true;
    return estimate_;
  }
  stamp_ = stamp;
  if (!fresh) scatter_.add(dt);
  params_ = given_;
  params_.stamp_noise = std::max(given_.stamp_noise, scatter_.stampNoise());
  if (!fresh) {
    filter_.predict(dt, params_);
    const bool accepted = filter_.correct(eta, params_);
    publish(accepted ? withSensors(stamp, eta) : filter_);
    fresh = !accepted && jump_.add(stamp, eta, params_);
    if (!accepted && !fresh) return reject("the pose jumped");
  }
  if (fresh) {
    accepted_ = rejected_ = 0;
    filter_.start(eta, params_);
    inertial_.restart();
    publish(filter_);
  }
  ++accepted_;
  used_stamp_ = stamp;
  rejected_ = std::max(rejected_ - 1, 0);
  jump_.clear();
  estimate_.pose = {eta, filter_.poseCovariance(params_), inertial_.measurement()};
  estimate_.used = true;
  estimate_.ignored = false;
  estimate_.valid = accepted_ >= kMinAccepted;
  estimate_.status = estimate_.valid ? "" : "too few poses since the filter started";
  return estimate_;
}

}  // namespace ground
