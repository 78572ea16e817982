#pragma once

#include <ros/time.h>

#include <chrono>
#include <string>

#include "ground/estimation/time_jump.h"

namespace ground {

/// From one instant to another [s], negative when the second is earlier. ros::Duration throws where
/// a senseless stamp is too far away, and toSec() alone rounds to a quarter of a microsecond.
inline double secondsBetween(const ros::Time& from, const ros::Time& to) {
  return (static_cast<double>(to.sec) - static_cast<double>(from.sec)) +
         1e-9 * (static_cast<double>(to.nsec) - static_cast<double>(from.nsec));
}

/// The steady clock of watchdogs. It runs whatever ROS's clock does. In simulated time it passes over
/// pauses of the process, which the simulation makes none of, either: all but the first 50 ms of a
/// while in which nobody has read it. Whoever waits by it has to read it more often than that.
struct WatchdogClock {
  using duration = std::chrono::steady_clock::duration;
  using rep = duration::rep;
  using period = duration::period;
  using time_point = std::chrono::time_point<WatchdogClock>;
  static constexpr bool is_steady = true;
  static constexpr std::chrono::milliseconds kLongestPause{50};
  /// Call from any thread.
  static time_point now();
};

/// The same in seconds.
inline double steadyNow() {
  return std::chrono::duration<double>(WatchdogClock::now().time_since_epoch()).count();
}

/// Notices that ROS time was set, on a wall clock or a simulated one, by the computer's own steady
/// clock: WatchdogClock passes over pauses, after which a clock seems to have jumped. One thread at a
/// time.
class RosTimeWatch {
 public:
  /// "time jumped back by 2.0 s" when it was set since the last call; empty otherwise.
  std::string look() {
    const double before = steady();
    const ros::Time time = ros::Time::now();
    // The two clocks are not read at the same instant when the computer is busy.
    if (time.isZero() || steady() - before > kLongestReading) return "";
    const auto clock = ros::Time::isSimTime() ? TimeJumpDetector::Clock::kSimulated
                                              : TimeJumpDetector::Clock::kWall;
    const double jump = detector_.update(before, secondsBetween(ros::Time(), time), clock);
    return jump == 0 ? "" : describeTimeJump(jump);
  }

 private:
  static double steady() {
    return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch())
        .count();
  }

  static constexpr double kLongestReading = 0.01;  // [s]

  TimeJumpDetector detector_;
};

}  // namespace ground
