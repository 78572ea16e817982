#pragma once

#include <algorithm>
#include <functional>
#include <utility>

namespace ground {

/// The time that a computation may take, on its caller's clock. The computation does its work in
/// pieces and begins another one only if there is time for one as long as the longest before.
///
///     budget.start(0.01);
///     while (budget.left()) improve();  // ends after 10 ms at most
class TimeBudget {
 public:
  using Clock = std::function<double()>;  ///< returns the time [s]

  /// Without a clock, time is never up.
  void setClock(Clock clock) { clock_ = std::move(clock); }
  /// Starts a computation that may take `seconds`.
  void start(double seconds) {
    is_up_ = false;
    longest_ = 0;
    if (!clock_) return;
    last_ = clock_();
    end_ = last_ + seconds;
  }
  /// Whether there is time for another piece; reads the clock. Once false, it stays false.
  bool left() {
    if (is_up_ || !clock_) return !is_up_;
    const double now = clock_();
    longest_ = std::max(longest_, now - last_);
    last_ = now;
    is_up_ = now + longest_ > end_;
    return !is_up_;
  }
  bool isUp() const { return is_up_; }

 private:
  Clock clock_;
  double last_ = 0, longest_ = 0, end_ = 0;  ///< [s]
  bool is_up_ = false;
};

}  // namespace ground
