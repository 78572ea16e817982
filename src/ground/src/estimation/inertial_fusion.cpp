#include "ground/estimation/inertial_fusion.h"

#include <algorithm>
#include <cmath>

namespace ground {
namespace {

constexpr double kSampleAge = 0.03;  // longest time without a sample before a pose [s]
constexpr double kBiasMemory = 3;    // of biases [s]
constexpr double kCompared = 0.2;    // over which distances are averaged [s]
constexpr double kMostDistance = 6;  // mean squared distance of filters that agree
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
  agreed_ = learned_ = distance_ = 0;
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
  if (!fresh) stop("no sample for too long");
  if (following_) {
    for (auto sample = samples_.begin(); sample != later; ++sample) {
      if (sample->stamp <= motion_.stamp()) continue;
      motion_.predict(sample->stamp, params);
      correctBy(*sample);
    }
  }
  // The last one stays: there may be fewer samples than poses.
  const auto kept = later == samples_.begin() ? later : later - 1;
  count_ = static_cast<std::size_t>(std::copy(kept, end, samples_.begin()) - samples_.begin());
  if (!fresh) return;
  if (!following_) {
    motion_ = by_poses;
    beginSpan(stamp, measuredBy(samples_[0]));
    following_ = true;
    return;
  }
  const double span = stamp - motion_.usedStamp();
  if (motion_.add(stamp, eta, params) != MotionFilter::Pose::kUsed || !motion_.velocity().allFinite()) {
    stop("they contradict the poses");
    return;
  }
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
  motion_.correctBy(2, 1, measured.z() + turn_bias_, kGyroNoise);
  const Vector2<double> push = atMarkers(measured.head<2>());
  if (mounting_.acceleration_scale != 0) {
    const Vector2<double> seen = bodyToWorld<double>(motion_.position().z(), push + bias_);
    for (int axis = 0; axis < 2; ++axis) motion_.correctBy(axis, 2, seen(axis), kPushNoise);
  }
  integrate(sample.stamp, measured);
  turns_ += measured.z();
  pushes_ += push;
  ++summed_;
}

/// Integrates what is measured, as linear between the samples.
void InertialFusion::integrate(double stamp, const Vector3<double>& felt) {
  const double half = 0.5 * (stamp - felt_at_);
  change_ += half * (felt_ + felt);
  outward_ += half * (felt_.z() * felt_.z() + felt.z() * felt.z());
  felt_ = felt;
  felt_at_ = stamp;
}

/// Makes measured_ of what was measured between two poses; `next`: the sample after the later one, if it has
/// come.
void InertialFusion::endSpan(double stamp, double span, const Sample* next) {
  Vector3<double> felt = felt_;
  if (next) felt += (stamp - felt_at_) / (next->stamp - felt_at_) * (measuredBy(*next) - felt_);
  integrate(stamp, felt);
  InertialMeasurement& measured = measured_.emplace();
  measured.span = span;
  const double turn = (felt.z() - began_rate_) / measured.span, outward = outward_ / measured.span;
  const double x = mounting_.ahead, y = mounting_.starboard;
  measured.acceleration =
      change_.head<2>() / measured.span + Vector2<double>(outward * x + turn * y, outward * y - turn * x);
  measured.yaw_rate = felt.z();
  const double push = mounting_.acceleration_scale == 0 ? kNoSensor : kMeanPushNoise;
  measured.variance << push * push, push * push, kGyroNoise * kGyroNoise;
  beginSpan(stamp, felt);
}

void InertialFusion::beginSpan(double stamp, const Vector3<double>& felt) {
  felt_at_ = stamp;
  felt_ = felt;
  began_rate_ = felt.z();
  change_.setZero();
  outward_ = 0;
}

Vector2<double> InertialFusion::atMarkers(const Vector2<double>& a) const {
  const double r = motion_.velocity().z(), turn = motion_.acceleration().z();
  const double x = mounting_.ahead, y = mounting_.starboard;
  return {a.x() + r * r * x + turn * y, a.y() + r * r * y - turn * x};
}

void InertialFusion::learnBias(const MotionFilter& by_poses, double dt) {
  if (summed_ == 0) return;
  learned_ = std::min(learned_ + dt, kBiasMemory);
  const double share = std::min(1.0, dt / std::max(learned_, 1e-3));
  const Vector2<double> push =
      worldToBody<double>(by_poses.position().z(), by_poses.acceleration().head<2>());
  turn_bias_ += share * (by_poses.velocity().z() - turns_ / summed_ - turn_bias_);
  bias_ += share * (push - pushes_ / summed_ - bias_);
  turns_ = 0;
  pushes_.setZero();
  summed_ = 0;
}

void InertialFusion::compare(const MotionFilter& by_poses, double dt) {
  const Vector3<double> away = motion_.velocity() - by_poses.velocity();
  double distance = 0;
  for (int axis = 0; axis < 3; ++axis)
    distance += away(axis) * away(axis) / (3 * by_poses.axes()[static_cast<std::size_t>(axis)].P(1, 1));
  distance_ += std::min(1.0, dt / kCompared) * (distance - distance_);
  const bool near = distance_ < kMostDistance;
  agreed_ = near ? agreed_ + dt : 0;
  status_ = !near ? "they contradict the poses" : agrees() ? "" : "they are compared with the poses";
}

}  // namespace ground
