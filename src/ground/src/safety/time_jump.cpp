#include "ground/safety/time_jump.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace ground {
namespace {

constexpr double kWallStep = 0.15;       // smallest jump of a wall clock [s]
constexpr double kSlew = 0.1;            // fastest slewing of a wall clock [s/s]; chrony: 0.083
constexpr double kSimulatedBack = 0.05;  // smallest jump back of a simulated clock [s]
constexpr double kSimulatedAhead = 0.5;  // smallest jump ahead of a simulated clock [s]
constexpr double kPaceWindow = 0.5;      // duration of a measurement of the pace [s]
constexpr double kPaceMemory = 0.7;      // smallest relative pace from one measurement to the next
constexpr double kBehindMemory = 1.0;    // time after which a delay is no longer caught up [s]

}  // namespace

double TimeJumpDetector::update(double steady, double time, Clock clock) {
  if (!started_ || clock != clock_) {
    reset();
    started_ = true;
    clock_ = clock;
    steady_ = pace_steady_ = steady;
    time_ = pace_time_ = time;
    return 0;
  }
  const double elapsed = steady - steady_, advance = time - time_;
  if (clock == Clock::kSimulated) return simulated(steady, time, elapsed, advance);
  steady_ = steady;
  time_ = time;
  return wall(elapsed, advance);
}

double TimeJumpDetector::wall(double elapsed, double advance) {
  divergence_ += advance - elapsed;
  divergence_ -= std::clamp(divergence_, -kSlew * elapsed, kSlew * elapsed);
  if (std::abs(divergence_) <= kWallStep) return 0;
  const double jump = divergence_;
  divergence_ = 0;
  return jump;
}

double TimeJumpDetector::simulated(double steady, double time, double elapsed, double advance) {
  if (advance == 0) return 0;
  const double expected = pace_ * elapsed;
  const double jump = advance < 0 ? advance : advance - expected - behind_;
  const bool jumped = advance < 0 ? advance < -kSimulatedBack : pace_known_ && jump > kSimulatedAhead;
  steady_ = steady;
  time_ = time;
  if (jumped) {
    behind_ = 0;
    pace_steady_ = steady;
    pace_time_ = time;
    return jump;
  }
  behind_ *= std::max(0.0, 1 - elapsed / kBehindMemory);
  behind_ = std::clamp(behind_ + expected - advance, 0.0, kBehindMemory * pace_);
  learnPace(steady, time);
  return 0;
}

/// Measures the pace. A pause lowers it only gradually, because the clock may catch up afterwards.
void TimeJumpDetector::learnPace(double steady, double time) {
  const double window = steady - pace_steady_;
  if (window < kPaceWindow) return;
  const double pace = (time - pace_time_) / window;
  pace_ = pace_known_ ? std::max(pace, kPaceMemory * pace_) : pace;
  pace_known_ = true;
  pace_steady_ = steady;
  pace_time_ = time;
}

std::string describeTimeJump(double jump) {
  char text[80];
  std::snprintf(text, sizeof text, "time jumped %s by %.1f s", jump < 0 ? "back" : "ahead", std::abs(jump));
  return text;
}

}  // namespace ground
