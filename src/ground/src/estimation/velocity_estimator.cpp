#include "ground/estimation/velocity_estimator.h"

#include <algorithm>
#include <cmath>

namespace ground {
namespace {

constexpr int kMinAccepted = 5;        // number of poses after which an estimate is valid
constexpr int kMaxRejected = 3;        // largest count of rejected poses of a valid estimate
constexpr double kBackwardJump = 1.0;  // an earlier stamp than this means that time jumped [s]

}  // namespace

void IntervalScatter::add(double dt) {
  const double clipped = count_ < kFirst ? dt : std::min(dt, kGap * mean_);
  count_ = std::min(count_ + 1, kMemory);
  mean_ += (clipped - mean_) / count_;
  variance_ += ((clipped - mean_) * (clipped - mean_) - variance_) / count_;
}

double IntervalScatter::stampNoise() const { return std::sqrt(variance_ / 2); }

void InnovationScatter::add(const MotionFilter& filter) {
  const Vector3<double> z = filter.innovation().cwiseAbs2().cwiseQuotient(filter.innovationVariance());
  count_ = std::min(count_ + 1, kMemory);
  position_ += (0.5 * (z(0) + z(1)) - position_) / count_;
  heading_ += (z(2) - heading_) / count_;
}

void VelocityEstimator::publish(const MotionFilter& motion) {
  estimate_.eta = motion.position();
  bodyMotion(motion.velocity(), motion.acceleration(), estimate_.eta.z(), estimate_.nu, estimate_.nu_dot);
  // A heading error rotates the velocity: (u, v) += (v, -u) d psi.
  const Vector2<double> turned(estimate_.nu.y(), -estimate_.nu.x());
  const Eigen::Matrix3d x = innovations_.excess(0) * motion.axes()[0].P,
                        y = innovations_.excess(1) * motion.axes()[1].P,
                        psi = innovations_.excess(2) * motion.axes()[2].P;
  estimate_.eta_covariance.diagonal() << x(0, 0), y(0, 0), psi(0, 0);
  Matrix3<double>& C = estimate_.nu_covariance;
  // x and y have the same model and noise, so rotation into the body frame preserves their mean.
  C.topLeftCorner<2, 2>() = psi(0, 0) * turned * turned.transpose();
  C.diagonal().head<2>().array() += 0.5 * (x(1, 1) + y(1, 1));
  C.topRightCorner<2, 1>() = psi(0, 1) * turned;
  C.bottomLeftCorner<1, 2>() = psi(0, 1) * turned.transpose();
  C(2, 2) = psi(1, 1);
}

const MotionFilter& VelocityEstimator::withSensors(double stamp, const Vector3<double>& eta) {
  inertial_.update(stamp, eta, filter_, params_);
  return inertial_.agrees() ? inertial_.motion() : filter_;
}

void VelocityEstimator::reset() {
  accepted_ = rejected_ = 0;
  filter_.forget();
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
  const double dt = stamp - filter_.stamp();
  if (dt < -kBackwardJump) filter_.forget();
  const bool leads = filter_.leadsTo(stamp, params_);
  if (leads && dt <= 0) {
    estimate_.used = false;
    estimate_.ignored = true;
    return estimate_;
  }
  if (leads) scatter_.add(dt);
  params_ = given_;
  params_.stamp_noise = std::max(given_.stamp_noise, scatter_.stampNoise());
  const MotionFilter::Pose pose = filter_.add(stamp, eta, params_);
  const bool used = pose == MotionFilter::Pose::kUsed;
  if (used) innovations_.add(filter_);
  publish(used ? withSensors(stamp, eta) : filter_);
  if (pose == MotionFilter::Pose::kRejected) return reject("the pose jumped");
  if (!used) {
    if (pose == MotionFilter::Pose::kJumped) filter_.start(stamp, eta, params_);
    accepted_ = rejected_ = 0;
    inertial_.restart();
    publish(filter_);
  }
  ++accepted_;
  rejected_ = std::max(rejected_ - 1, 0);
  estimate_.pose = {eta, filter_.poseCovariance(params_), inertial_.measurement()};
  estimate_.used = true;
  estimate_.ignored = false;
  estimate_.valid = accepted_ >= kMinAccepted;
  estimate_.status = estimate_.valid ? "" : "too few poses since the filter started";
  return estimate_;
}

}  // namespace ground
