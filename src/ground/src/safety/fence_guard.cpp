#include "ground/safety/fence_guard.h"

#include "ground/safety/freshness.h"

namespace ground {

void FenceGuard::state(double now, const MeasuredState& measured) {
  last_ = measured;
  last_->valid = measured.valid && measured.finite() && measured.stamp - now <= Freshness::kMaxAhead;
  if (!(measured.stamp <= now)) last_->stamp = now;
  if (!last_->valid) return;
  valid_ = last_;
  const auto later = [&](const Thrust& one) { return one.since > valid_->stamp; };
  const auto next =
      std::find_if(thrusts_.begin(), thrusts_.end(), later);  // the one before it acts at the stamp
  if (next != thrusts_.begin()) thrusts_.erase(thrusts_.begin(), next - 1);
}

void FenceGuard::sent(double time, const Vector2<double>& acceleration) {
  if (!fence_ || !valid_) thrusts_.clear();  // only the last one may count
  if (thrusts_.empty() || thrusts_.back().acceleration != acceleration)
    thrusts_.push_back({time, acceleration});
}

void FenceGuard::reset() {
  last_.reset();
  valid_.reset();
  thrusts_.clear();
}

std::string FenceGuard::objection(double now) const {
  if (!fence_ || !last_) return "";
  if (valid_ && !last_->valid) {
    const std::string problem = objection(now, *valid_);
    if (!problem.empty()) return problem;
  }
  return last_->finite() ? objection(now, *last_) : "";
}

/// Why the craft leaves the room from a state on, with the thrust since then; empty if it does not.
std::string FenceGuard::objection(double now, const MeasuredState& from) const {
  Fence::Thrusts thrusts;
  for (std::size_t i = 0; i < thrusts_.size(); ++i) {
    const double begin = std::max(thrusts_[i].since, from.stamp);
    const double end = i + 1 < thrusts_.size() ? thrusts_[i + 1].since : now;
    thrusts.push_back({thrusts_[i].acceleration, std::max(0.0, end - begin)});
  }
  return fence_->objection(from.state, now - from.stamp, thrusts);
}

}  // namespace ground
