// Jumps of a clock, found by comparing it with a steady clock.
#include "ground/safety/time_jump.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <vector>

namespace ground {
namespace time_jump_test {

using Clock = TimeJumpDetector::Clock;

/// Jumps found when a clock is read every `period` [s] of steady time for `duration` [s].
std::vector<double> jumps(Clock clock, const std::function<double(double)>& shown, double duration,
                          double period = 0.005) {
  TimeJumpDetector detector;
  std::vector<double> found;
  for (double steady = 0; steady < duration; steady += period) {
    const double jump = detector.update(steady, shown(steady), clock);
    if (jump != 0) found.push_back(jump);
  }
  return found;
}

/// A clock that is set by `by` [s] after 5 s.
std::function<double(double)> set(double by, double pace = 1) {
  return [=](double t) { return 1000 + pace * t + (t >= 5 ? by : 0); };
}

TEST(TimeJump, IsFoundInAWallClockInBothDirections) {
  for (double by : {-2.0, -0.2, 0.2, 2.0, 3600.0}) {
    const std::vector<double> found = jumps(Clock::kWall, set(by), 10);
    ASSERT_EQ(found.size(), 1u) << by;
    EXPECT_NEAR(found[0], by, 0.002);
  }
  EXPECT_TRUE(jumps(Clock::kWall, set(0.1), 10).empty());
}

TEST(TimeJump, IsNotFoundInASlewedWallClock) {
  for (double rate : {-0.083, -5e-4, 5e-4, 0.083})
    EXPECT_TRUE(jumps(
                    Clock::kWall, [&](double t) { return t * (1 + rate); }, 600)
                    .empty())
        << rate;
  // The same if it is read rarely.
  EXPECT_TRUE(jumps(
                  Clock::kWall, [](double t) { return 0.917 * t; }, 600, 30)
                  .empty());
}

TEST(TimeJump, IsFoundInASimulatedClockAtAnyPace) {
  for (double pace : {0.1, 1.0, 5.0, 20.0}) {
    for (double by : {-2.0, -0.5, 2.0}) {
      const std::vector<double> found = jumps(Clock::kSimulated, set(by, pace), 10);
      ASSERT_EQ(found.size(), 1u) << by << " at " << pace;
      EXPECT_NEAR(found[0], by, 0.11 * std::max(1.0, pace));
    }
  }
}

TEST(TimeJump, IsNotFoundInPausesPacesAndStepsOfASimulatedClock) {
  const auto none = [](const std::function<double(double)>& shown, double period = 0.005) {
    return jumps(Clock::kSimulated, shown, 20, period).empty();
  };
  for (double pace : {0.1, 1.0, 20.0}) {
    EXPECT_TRUE(none([&](double t) { return pace * t; }));
    // It shows tenths of a second only.
    EXPECT_TRUE(none([&](double t) { return 0.1 * std::floor(10 * pace * t); }));
    // It stops for three seconds and continues.
    EXPECT_TRUE(none([&](double t) { return pace * (t < 8 ? t : std::max(8.0, t - 3)); }));
    // It stops for half a second and catches up at once or in steps.
    const auto behind = [](double t) { return t > 8 && t < 8.5 ? 8.0 : t; };
    EXPECT_TRUE(none([&](double t) { return pace * behind(t); }));
    const auto twice = [](double t) { return t > 8 && t < 8.5 ? 8.0 : t < 8.51 ? std::min(t, 8.02) : t; };
    EXPECT_TRUE(none([&](double t) { return pace * twice(t); }));
    // Its reader is delayed.
    EXPECT_TRUE(none([&](double t) { return pace * t; }, 0.3));
  }
  // A user makes it twenty times as fast, and slow again.
  EXPECT_TRUE(none([](double t) { return t < 5 ? t : t < 10 ? 5 + 20 * (t - 5) : 95 + t; }));
}

TEST(TimeJump, IsFoundInASimulatedClockAfterAPause) {
  const std::vector<double> found = jumps(
      Clock::kSimulated, [](double t) { return t < 5   ? t
                                               : t < 8 ? 5
                                                       : t + 2; }, 12);
  ASSERT_FALSE(found.empty());
  EXPECT_GT(found[0], 0.5);
}

}  // namespace time_jump_test
}  // namespace ground
