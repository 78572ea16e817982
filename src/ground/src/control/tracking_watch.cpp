#include "ground/control/tracking_watch.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace ground {
namespace {

constexpr int kSamples = 400;  // samples of a reference, to measure its size
constexpr double kShare = 0.25;
constexpr double kMinError = 0.05, kMaxError = 0.5;  // [m]

}  // namespace

double defaultMaxError(const ReferenceTrajectory& reference) {
  Vector2<double> low = reference.at(0).p, high = low;
  for (int i = 1; i <= kSamples; ++i) {
    const Vector2<double> p = reference.at(reference.extent() * i / kSamples).p;
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  return std::clamp(kShare * (high - low).maxCoeff() / 2, kMinError, kMaxError);
}

void TrackingWatch::restart() {
  const double max_error = max_error_;
  *this = TrackingWatch();
  max_error_ = max_error;
}

std::string TrackingWatch::look(double time, double error) {
  if (!begun_) {
    begun_ = true;
    last_time_ = time;
  }
  const double seen = std::clamp(time - last_time_, 0.0, kLongestInterval);
  if (time - last_time_ > kLongestInterval && inside_ > 0) caught_up_ = time + kCatchUp;
  last_time_ = std::max(last_time_, time);

  inside_ = error <= max_error_ ? inside_ + seen : 0;
  arrived_ = arrived_ || inside_ >= kPatience;
  if (!arrived_) approaching_ += seen;
  outside_ = error <= max_error_ || !arrived_ || time < caught_up_ ? 0 : outside_ + seen;

  char text[160] = "";
  if (outside_ >= kPatience)
    std::snprintf(text, sizeof text, "%.2f m from the reference for %g s, more than max_error %.3g m", error,
                  kPatience, max_error_);
  if (!arrived_ && approaching_ >= kApproach)
    std::snprintf(text, sizeof text,
                  "%.2f m from the reference, and never within max_error %.3g m for %g s in %g s", error,
                  max_error_, kPatience, kApproach);
  return text;
}

}  // namespace ground
