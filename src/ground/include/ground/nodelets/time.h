#pragma once

#include <ros/time.h>

#include <chrono>
#include <string>

#include "ground/safety/time_jump.h"

namespace ground {

/// Time from one instant to another [s], negative if the second is earlier. ros::Duration would
/// throw for an invalid stamp that is too far away, and toSec() alone rounds to a quarter of a
/// microsecond.
inline double secondsBetween(const ros::Time& from, const ros::Time& to) {
  return (static_cast<double>(to.sec) - static_cast<double>(from.sec)) +
         1e-9 * (static_cast<double>(to.nsec) - static_cast<double>(from.nsec));
}

/// Time of the steady clock of watchdogs, independent of ROS time [s]. In simulated time it skips pauses of
/// the process, because the simulation pauses with it: if the clock is not read for longer than 50 ms, it
/// advances by only 50 ms. A thread that waits by it must read it more often than that. Call from any
/// thread.
double steadyNow();

/// Detects that ROS time was set, on a wall clock or a simulated one, by comparison with the
/// computer's steady clock. steadyNow() would not do: after a pause, which it skips, ROS time
/// would seem to have jumped. One thread at a time.
class RosTimeWatch {
 public:
  /// Text such as "time jumped back by 2.0 s" if ROS time was set since the last call; else empty.
  std::string look() {
    const double before = steady();
    const ros::Time time = ros::Time::now();
    // On a busy computer there may be a pause between reading the two clocks.
    if (time.isZero() || steady() - before > kLongestReading) return "";
    const auto clock =
        ros::Time::isSimTime() ? TimeJumpDetector::Clock::kSimulated : TimeJumpDetector::Clock::kWall;
    const double jump = detector_.update(before, secondsBetween(ros::Time(), time), clock);
    return jump == 0 ? "" : describeTimeJump(jump);
  }

 private:
  static double steady() {
    return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
  }

  static constexpr double kLongestReading = 0.01;  // [s]

  TimeJumpDetector detector_;
};

}  // namespace ground
