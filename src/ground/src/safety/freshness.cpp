#include "ground/safety/freshness.h"

namespace ground {

void Freshness::received(Instant now, double stamp) {
  const bool believed = stamp - now.time <= kMaxAhead;  // false for NaN
  at_ = believed ? Instant{now.steady, stamp} : Instant{kNever, kNever};
}

bool Freshness::stale(Instant now, double timeout) const {
  const Instant end = until(timeout);
  return !(now.steady < end.steady && now.time < end.time);
}

void StateLoss::received(Instant now, double stamp, bool valid, const std::string& why) {
  known_ = true;
  valid_ = valid;
  why_ = why;
  freshness_.received(now, stamp);
}

std::string StateLoss::problem(Instant now, double timeout) const {
  if (!known_) return "there is no state";
  if (!valid_) return "the state is invalid" + (why_.empty() ? "" : ": " + why_);
  return freshness_.stale(now, timeout) ? "the state is stale" : "";
}

}  // namespace ground
