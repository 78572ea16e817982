#include "ground/model/drive_clock.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

namespace ground {

DriveClock::DriveClock(std::vector<double> starts) : starts_(std::move(starts)) {
  for (std::size_t i = 0; i < starts_.size(); ++i)
    if (!std::isfinite(starts_[i]) || (i > 0 && starts_[i] <= starts_[i - 1]))
      throw std::invalid_argument("the starts of drives must be finite and ascending");
}

bool DriveClock::command(double time, double lift) {
  if (time < newest_ - kDisorder) {
    while (!starts_.empty() && starts_.back() > time) starts_.pop_back();
    if (starts_.empty()) {
      lifting_ = false;
      off_since_ = kNever;
    }
    off_since_ = std::min(off_since_, time);
    newest_ = time;
  }
  newest_ = std::max(newest_, time);
  const bool lifted = lifting_;
  lifting_ = lift > 0;
  if (lifted && !lifting_) off_since_ = newest_;
  if (lifted || !lifting_ || !(newest_ - off_since_ > kPause)) return false;
  starts_.push_back(newest_);
  return true;
}

void DriveClock::record(double began, double as_of) {
  if (!std::isfinite(began) || !std::isfinite(as_of) || began > as_of) return;
  const auto first = std::lower_bound(starts_.begin(), starts_.end(), began - kDisorder);
  const auto last = std::upper_bound(first, starts_.end(), as_of);
  starts_.insert(starts_.erase(first, last), began);
  // Without earlier commands, the next command with lift belongs to the recorded drive.
  if (newest_ == kNever) off_since_ = as_of;
}

double DriveClock::origin(double time) const {
  if (starts_.empty()) return std::numeric_limits<double>::infinity();
  const auto next = std::upper_bound(starts_.begin(), starts_.end(), time);
  return next == starts_.begin() ? *next : *(next - 1);
}

double DriveClock::since(double time) const { return std::max(0.0, time - origin(time)); }

}  // namespace ground
