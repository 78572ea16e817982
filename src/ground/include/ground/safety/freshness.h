#pragma once

#include <limits>
#include <string>

namespace ground {

/// One instant on two clocks: the steady clock of the watchdogs, and the clock of stamps, which may
/// be set. A simulation has one clock for both.
struct Instant {
  double steady, time;  ///< [s]
};

/// Tells when the newest message is stale: `timeout` after it came, by the steady clock, or `timeout` after
/// its stamp, by the clock of stamps, whichever is earlier. So neither a late message nor a clock that stands
/// still makes an old one fresh. A stamp more than kMaxAhead in the future is from another clock: the message
/// is stale at once. Without a message, everything is stale.
///
///     Freshness commands;
///     commands.received(now, stamp);
///     if (commands.stale(now, 0.2)) ...
///
/// It does not hear of a clock that was set: call reset() then.
class Freshness {
 public:
  static constexpr double kMaxAhead = 1.0;  ///< [s]

  void received(Instant now, double stamp);
  void reset() { at_ = {kNever, kNever}; }
  /// From when on it is stale, on each clock [s].
  Instant until(double timeout) const { return {at_.steady + timeout, at_.time + timeout}; }
  bool stale(Instant now, double timeout) const;

 private:
  static constexpr double kNever = -std::numeric_limits<double>::infinity();

  Instant at_{kNever, kNever};  ///< when the message came, and its stamp
};

/// Whether the state of the craft is lost. A controller and the sender mean the same by it.
class StateLoss {
 public:
  /// `why`: why the state is invalid, if it is.
  void received(Instant now, double stamp, bool valid, const std::string& why);
  void reset() { *this = StateLoss(); }
  /// Why the state is lost; empty if it is not.
  std::string problem(Instant now, double timeout) const;
  bool valid() const { return valid_; }
  /// From when on the state is stale, on each clock [s].
  Instant until(double timeout) const { return freshness_.until(timeout); }

 private:
  Freshness freshness_;
  bool known_ = false, valid_ = false;
  std::string why_;
};

}  // namespace ground
