#include "ground/estimation/inertial_fusion.h"

#include <algorithm>
#include <cmath>

namespace ground {
namespace {

constexpr double kSampleAge = 0.03;  // longest time without a sample before a pose [s]
constexpr double kBiasMemory = 3;    // of biases [s]
constexpr double kCompared = 0.5;    // over which innovations are averaged [s]
constexpr double kWorse = 2;         // largest mean squared innovation relative to that without the sensors
constexpr double kGyroNoise = 4e-3,
                 kPushNoise = 0.1;       // of a sample, with what its bias leaves [rad/s], [m/s^2]
constexpr double kMeanPushNoise = 0.05;  // of a mean between poses, whose bias is estimated [m/s^2]
constexpr double kNoSensor = 1e3;        // deviation of an acceleration that is not measured [m/s^2]

}  // namespace

void InertialFusion::setMounting(const InertialMounting& mounting) {
  mounting_ = mounting;
  restart();
}

void InertialFusion::restart() {
  stop("no samples yet");
  count_ = 0;
}

void InertialFusion::stop(const char* why) {
  following_ = false;
  agreed_ = learned_ = with_ = without_ = 0;
  bias_.setZero();
  status_ = why;
}

void InertialFusion::sample(double stamp, double gyro, const Vector2<double>& acceleration) {
  if (mounting_.gyro_scale == 0 || !std::isfinite(stamp) || !std::isfinite(gyro) || !acceleration.allFinite())
    return;
  const Sample sample{stamp - mounting_.delay, gyro, acceleration};
  if (count_ > 0 && sample.stamp <= samples_[count_ - 1].stamp) return;
  if (count_ == samples_.size()) {  // the poses have stopped: the oldest ones are of no use
    std::copy(samples_.begin() + samples_.size() / 2, samples_.end(), samples_.begin());
    count_ = samples_.size() / 2;
  }
  samples_[count_++] = sample;
}

void InertialFusion::update(double stamp, const Vector3<double>& eta, const MotionFilter& by_poses,
                            const EstimatorParams& params) {
  if (mounting_.gyro_scale == 0) return;
  const auto end = samples_.begin() + static_cast<std::ptrdiff_t>(count_);
  const auto later = std::find_if(samples_.begin(), end, [&](const Sample& s) { return s.stamp > stamp; });
  const bool fresh = later != samples_.begin() && stamp - (later - 1)->stamp < kSampleAge;
  for (auto sample = samples_.begin(); fresh && following_ && sample != later; ++sample) {
    if (sample->stamp <= motion_.stamp()) continue;
    motion_.predict(sample->stamp, params);
    correctBy(*sample);
  }
  // The last one stays: there may be fewer samples than poses.
  const auto kept = later == samples_.begin() ? later : later - 1;
  count_ = static_cast<std::size_t>(std::copy(kept, end, samples_.begin()) - samples_.begin());
  if (!fresh) return stop("no sample for too long");
  if (!following_) {
    motion_ = by_poses;
    beginSpan(stamp, measuredBy(samples_[0]));
    following_ = true;
    return;
  }
  const MotionFilter::Pose pose = motion_.add(stamp, eta, params);
  if (pose != MotionFilter::Pose::kUsed && pose != MotionFilter::Pose::kRejected)
    return stop("they contradict the poses");
  const double span = stamp - began_;
  endSpan(stamp, span, count_ > 1 ? &samples_[1] : nullptr);
  learnBias(by_poses, span);
  compare(by_poses, span);
}

Vector3<double> InertialFusion::measuredBy(const Sample& sample) const {
  const double up = mounting_.gyro_scale < 0 ? -1 : 1;  // whose frame is left-handed seen from above
  const Vector2<double> force =
      mounting_.acceleration_scale * Vector2<double>(sample.acceleration.x(), up * sample.acceleration.y());
  Vector3<double> measured;
  measured << Rotation<double>(mounting_.mounting).toWorld(force), mounting_.gyro_scale * sample.gyro;
  return measured;
}

void InertialFusion::correctBy(const Sample& sample) {
  const Vector3<double> measured = measuredBy(sample);
  motion_.correctBy(2, 1, measured.z() + bias_.z(), kGyroNoise);
  if (mounting_.acceleration_scale != 0) {
    const double r = motion_.velocity().z();
    const Vector2<double> push = measured.head<2>() + lever(r * r, motion_.acceleration().z());
    const Vector2<double> seen = bodyToWorld<double>(motion_.position().z(), push + bias_.head<2>());
    for (int axis = 0; axis < 2; ++axis) motion_.correctBy(axis, 2, seen(axis), kPushNoise);
  }
  integrate(sample.stamp, measured);
}

/// Integrates what is measured, as linear between the samples.
void InertialFusion::integrate(double stamp, const Vector3<double>& measured) {
  const double half = 0.5 * (stamp - last_stamp_);
  change_ += half * (last_ + measured);
  outward_ += half * (last_.z() * last_.z() + measured.z() * measured.z());
  last_ = measured;
  last_stamp_ = stamp;
}

/// Makes measured_ of what was measured between two poses; `next`: the sample after the later one, if it has
/// come.
void InertialFusion::endSpan(double stamp, double span, const Sample* next) {
  Vector3<double> now = last_;
  if (next) now += (stamp - last_stamp_) / (next->stamp - last_stamp_) * (measuredBy(*next) - last_);
  integrate(stamp, now);
  InertialMeasurement& measured = measured_.emplace();
  measured.span = span;
  const double turn = (now.z() - began_rate_) / span, outward = outward_ / span;
  measured.acceleration = change_.head<2>() / span + lever(outward, turn);
  measured.yaw_rate = now.z();
  const double push = mounting_.acceleration_scale == 0 ? kNoSensor : kMeanPushNoise;
  measured.variance << push * push, push * push, kGyroNoise * kGyroNoise;
  beginSpan(stamp, now);
}

void InertialFusion::beginSpan(double stamp, const Vector3<double>& measured) {
  began_ = last_stamp_ = stamp;
  last_ = measured;
  began_rate_ = measured.z();
  change_.setZero();
  outward_ = 0;
}

/// How the acceleration of the markers differs from the sensor's, by the squared yaw rate and its derivative.
Vector2<double> InertialFusion::lever(double outward, double turn) const {
  const double x = mounting_.ahead, y = mounting_.starboard;
  return {outward * x + turn * y, outward * y - turn * x};
}

void InertialFusion::learnBias(const MotionFilter& by_poses, double dt) {
  learned_ = std::min(learned_ + dt, kBiasMemory);
  Vector3<double> off;
  off << worldToBody<double>(by_poses.position().z(), by_poses.acceleration().head<2>()),
      by_poses.velocity().z();
  off.head<2>() -= measured_->acceleration;
  off.z() -= measured_->yaw_rate;
  bias_ += std::min(1.0, dt / learned_) * (off - bias_);
}

void InertialFusion::compare(const MotionFilter& by_poses, double dt) {
  const double share = std::min(1.0, dt / kCompared);
  const auto squared = [&](const MotionFilter& filter) {
    return filter.innovation().cwiseAbs2().cwiseQuotient(by_poses.innovationVariance()).sum();
  };
  with_ += share * (squared(motion_) - with_);
  without_ += share * (squared(by_poses) - without_);
  const bool near = with_ <= kWorse * without_;
  agreed_ = near ? agreed_ + dt : 0;
  status_ = !near ? "they contradict the poses" : agrees() ? "" : "they are compared with the poses";
}

}  // namespace ground
