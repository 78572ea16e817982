#include "ground/estimation/motion_filter.h"

#include <Eigen/LU>
#include <cmath>

namespace ground {
namespace {

constexpr double kUnknownMotion = 3.0;  // largest speed of a craft with unknown motion [usual ones]

/// Whether a craft can move from one pose to the next within dt [s]. Headings are compared as angles.
bool sameMotion(const Vector3<double>& from, const Vector3<double>& to, double dt,
                const EstimatorParams& params) {
  for (int i = 0; i < 3; ++i) {
    const double step = i < 2 ? to(i) - from(i) : wrapAngle(to(i) - from(i));
    const double noise = params.gate * M_SQRT2 * params.noise(i);
    if (std::abs(step) > noise + kUnknownMotion * params.speed(i) * (dt + params.gate * params.stamp_noise))
      return false;
  }
  return true;
}

Eigen::Matrix3d transition(double dt) {
  Eigen::Matrix3d F;
  F << 1, dt, dt * dt / 2, 0, 1, dt, 0, 0, 1;
  return F;
}

}  // namespace

void AxisFilter::start(double position, double r, double usual_speed) {
  const double v = usual_speed, a = 3 * usual_speed;
  x << position, 0, 0;
  P = Eigen::Vector3d(r, v * v, a * a).asDiagonal();
}

void AxisFilter::predict(double dt, double q) {
  const Eigen::Matrix3d F = transition(dt);
  const double d2 = dt * dt, d3 = d2 * dt, d4 = d3 * dt, d5 = d4 * dt;
  Eigen::Matrix3d Q;
  Q << d5 / 20, d4 / 8, d3 / 6, d4 / 8, d3 / 3, d2 / 2, d3 / 6, d2 / 2, dt;
  x = F * x;
  P = F * P * F.transpose() + q * Q;
}

void AxisFilter::correct(int i, double innovation, double r) {
  const Eigen::Vector3d K = P.col(i) / (P(i, i) + r);
  x += K * innovation;
  P -= K * P.row(i).eval();
  P = 0.5 * (P + P.transpose()).eval();
}

Eigen::Vector3d AxisFilter::smoothed(const Eigen::Vector3d& later, double dt, double q) const {
  AxisFilter next = *this;
  next.predict(dt, q);
  const Eigen::Matrix3d gain = P * transition(dt).transpose() * next.P.inverse();
  return x + gain * (later - next.x);
}

MotionFilter::Pose MotionFilter::add(double stamp, const Vector3<double>& eta,
                                     const EstimatorParams& params) {
  if (!leadsTo(stamp, params)) {
    start(stamp, eta, params);
    return Pose::kStarts;
  }
  predict(stamp, params);
  if (!correct(eta, params)) return contradicted(eta, params) ? Pose::kJumped : Pose::kRejected;
  used_stamp_ = stamp;
  rejected_ = 0;
  return Pose::kUsed;
}

void MotionFilter::start(double stamp, const Vector3<double>& eta, const EstimatorParams& params) {
  const double before = axes_[2].x(0);
  for (int i = 0; i < 3; ++i) {
    const double position = i < 2 ? eta(i) : before + wrapAngle(eta(2) - before);
    axes_[i].start(position, params.noise(i) * params.noise(i), params.speed(i));
  }
  stamp_ = used_stamp_ = stamp;
  started_ = true;
  rejected_ = 0;
}

void MotionFilter::predict(double stamp, const EstimatorParams& params) {
  for (int i = 0; i < 3; ++i) axes_[i].predict(stamp - stamp_, params.jerk(i) * params.jerk(i));
  stamp_ = stamp;
}

bool MotionFilter::correct(const Vector3<double>& eta, const EstimatorParams& params) {
  innovation_ = eta - position();
  innovation_(2) = wrapAngle(innovation_(2));
  std::array<AxisFilter, 3> corrected = axes_;
  bool sound = true;
  for (int i = 0; i < 3; ++i) {
    const double by_stamp = params.stamp_noise * axes_[i].x(1);
    const double r = params.noise(i) * params.noise(i) + by_stamp * by_stamp;
    innovation_variance_(i) = axes_[i].P(0, 0) + r;
    corrected[i].correct(0, innovation_(i), r);
    sound = sound && innovation_(i) * innovation_(i) <= params.gate * params.gate * innovation_variance_(i) &&
            std::abs(corrected[i].x(1)) <= params.most * params.speed(i);
  }
  if (sound) axes_ = corrected;
  return sound;
}

/// Counts a rejected pose; returns whether there are enough that agree with each other.
bool MotionFilter::contradicted(const Vector3<double>& eta, const EstimatorParams& params) {
  const bool agrees = rejected_ > 0 && sameMotion(rejected_eta_, eta, stamp_ - rejected_stamp_, params);
  rejected_ = agrees ? rejected_ + 1 : 1;
  rejected_stamp_ = stamp_;
  rejected_eta_ = eta;
  return rejected_ >= kMinPoses;
}

Matrix3<double> MotionFilter::poseCovariance(const EstimatorParams& params) const {
  const Vector3<double> way = params.stamp_noise * velocity();
  Matrix3<double> covariance = way * way.transpose();
  for (int i = 0; i < 3; ++i) covariance(i, i) += params.noise(i) * params.noise(i);
  return covariance;
}

void bodyMotion(const Vector3<double>& velocity, const Vector3<double>& acceleration, double psi,
                Vector3<double>& nu, Vector3<double>& nu_dot) {
  const Vector2<double> v = velocity.head<2>(), a = acceleration.head<2>();
  nu << worldToBody<double>(psi, v), velocity.z();
  // d/dt (R' v) = R' a - r S R' v
  nu_dot << worldToBody<double>(psi, a) + nu.z() * Vector2<double>(nu.y(), -nu.x()), acceleration.z();
}

}  // namespace ground
