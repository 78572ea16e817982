#include "ground/estimation/motion_filter.h"

#include <algorithm>
#include <cmath>

namespace ground {

bool sameMotion(const Vector3<double>& from, const Vector3<double>& to, double dt, double times,
                const EstimatorParams& params) {
  for (int i = 0; i < 3; ++i) {
    const double step = i < 2 ? to(i) - from(i) : wrapAngle(to(i) - from(i));
    const double noise = params.gate * M_SQRT2 * params.noise(i);
    if (std::abs(step) > noise + times * params.speed(i) * (dt + params.gate * params.stamp_noise))
      return false;
  }
  return true;
}

Eigen::Matrix3d AxisFilter::transition(double dt) {
  Eigen::Matrix3d F;
  F << 1, dt, dt * dt / 2, 0, 1, dt, 0, 0, 1;
  return F;
}

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

void AxisFilter::correct(double innovation, double r) { correct(0, innovation, r); }

void AxisFilter::correct(int i, double innovation, double r) {
  const Eigen::Vector3d K = P.col(i) / (P(i, i) + r);
  x += K * innovation;
  P -= K * P.row(i).eval();
  P = 0.5 * (P + P.transpose()).eval();
}

void MotionFilter::start(const Vector3<double>& eta, const EstimatorParams& params) {
  const double before = axes_[2].x(0);
  for (int i = 0; i < 3; ++i) {
    const double position = i < 2 ? eta(i) : before + wrapAngle(eta(2) - before);
    axes_[i].start(position, params.noise(i) * params.noise(i), params.speed(i));
  }
}

void MotionFilter::predict(double dt, const EstimatorParams& params) {
  for (int i = 0; i < 3; ++i) axes_[i].predict(dt, params.jerk(i) * params.jerk(i));
}

bool MotionFilter::correct(const Vector3<double>& eta, const EstimatorParams& params) {
  Vector3<double> innovation = eta - position(), r;
  innovation(2) = wrapAngle(innovation(2));
  for (int i = 0; i < 3; ++i) {
    const double by_stamp = params.stamp_noise * axes_[i].x(1);
    r(i) = params.noise(i) * params.noise(i) + by_stamp * by_stamp;
    const double s = axes_[i].P(0, 0) + r(i);
    if (innovation(i) * innovation(i) > params.gate * params.gate * s) return false;
  }
  std::array<AxisFilter, 3> corrected = axes_;
  for (int i = 0; i < 3; ++i) {
    corrected[i].correct(innovation(i), r(i));
    if (std::abs(corrected[i].x(1)) > params.most * params.speed(i)) return false;
  }
  axes_ = corrected;
  return true;
}

Matrix3<double> MotionFilter::poseCovariance(const EstimatorParams& params) const {
  const Vector3<double> way = params.stamp_noise * velocity();
  Matrix3<double> covariance = way * way.transpose();
  for (int i = 0; i < 3; ++i) covariance(i, i) += params.noise(i) * params.noise(i);
  return covariance;
}

void IntervalScatter::add(double dt) {
  const double clipped = count_ < kFirst ? dt : std::min(dt, kGap * mean_);
  count_ = std::min(count_ + 1, kMemory);
  mean_ += (clipped - mean_) / count_;
  variance_ += ((clipped - mean_) * (clipped - mean_) - variance_) / count_;
}

double IntervalScatter::stampNoise() const { return std::sqrt(variance_ / 2); }

bool JumpDetector::add(double stamp, const Vector3<double>& eta, const EstimatorParams& params) {
  count_ = count_ > 0 && sameMotion(eta_, eta, stamp - stamp_, kUnknownMotion, params) ? count_ + 1 : 1;
  stamp_ = stamp;
  eta_ = eta;
  return count_ >= kMinPoses;
}

}  // namespace ground
