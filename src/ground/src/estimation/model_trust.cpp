#include "ground/estimation/model_trust.h"

#include <algorithm>
#include <cmath>

namespace ground {

void ModelTrust::reset() { *this = ModelTrust(scale_); }

/// Length of a hold before a change at a time [s].
double ModelTrust::required(double time) const {
  const auto recent = std::count_if(interruptions_.begin(), interruptions_.end(),
                                    [&](double t) { return time - t < kMemory * scale_; });
  return kHold * scale_ * std::exp2(static_cast<double>(recent));
}

void ModelTrust::observe(double time) {
  if (!began_) began_ = held_since_ = time;
  if (!holdsBefore(time)) return;
  has_held_ = true;
  failures_.clear();
  doubt_since_.reset();
}

bool ModelTrust::holdsBefore(double start) const {
  return began_ && start - held_since_ > required(start) - 1e-6;
}

void ModelTrust::fail(double time) {
  failures_.push_back(time);
  if (static_cast<int>(failures_.size()) == kFailures)
    doubt_since_ = has_held_ ? failures_.front() : began_.value_or(time);
  interrupt(time);
}

void ModelTrust::hit(double time) {
  if (began_ && !has_held_) fail(time);
}

void ModelTrust::interrupt(double time) {
  held_since_ = time;
  interruptions_.push_back(time);
  while (time - interruptions_.front() > kMemory * scale_) interruptions_.pop_front();
}

}  // namespace ground
