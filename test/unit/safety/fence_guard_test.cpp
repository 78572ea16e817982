// What the fence knows of a craft's motion, and when a message is stale.
#include "ground/safety/fence_guard.h"

#include <gtest/gtest.h>

#include <limits>

#include "ground/safety/freshness.h"

namespace ground {
namespace fence_guard_test {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

MeasuredState at(double stamp, double x, bool valid = true) {
  MeasuredState measured;
  measured.stamp = stamp;
  measured.state = {Vector3<double>(x, 0, 0), Vector3<double>(0, 0, 0)};
  measured.valid = valid;
  return measured;
}

/// A guard of 4 x 4 m up to the walls.
class Guard : public testing::Test {
 protected:
  Guard() { guard.setFence(Fence(Room(), 0)); }
  FenceGuard guard;
  const Vector2<double> push{2, 0};  ///< [m/s^2]
};

TEST_F(Guard, WithoutRoomOrStateThereIsNoObjection) {
  EXPECT_EQ(guard.objection(1), "");
  guard.state(1, at(1, 3));
  EXPECT_NE(guard.objection(1), "");
  guard.setFence(std::nullopt);
  EXPECT_EQ(guard.objection(1), "");
}

// At rest 0.5 m from the wall. With 2 m/s^2 for t and the latency of 0.1 s it is at the wall after about 0.46
// s.
TEST_F(Guard, CountsTheThrustSinceTheLastState) {
  guard.state(1, at(1, 1.5));
  guard.sent(1, push);
  EXPECT_EQ(guard.objection(1.2), "");
  EXPECT_NE(guard.objection(1.5), "");
  guard.state(1.49, at(1.49, 1.5));
  EXPECT_EQ(guard.objection(1.5), "") << "the state has what came before it";
  guard.sent(1.5, -push);
  EXPECT_EQ(guard.objection(1.9), "") << "it drives away from the wall";
}

TEST_F(Guard, CarriesOnFromTheLastValidStateWhileStatesAreInvalid) {
  guard.state(1, at(1, 1.5));
  guard.sent(1, push);
  for (double t = 1; t < 1.5; t += 0.01) guard.state(t, at(t, 1.5, false));  // a fresh stamp, the old place
  EXPECT_NE(guard.objection(1.5), "");
  guard.state(1.5, at(1.5, kNan));
  EXPECT_NE(guard.objection(1.5), "");
}

TEST_F(Guard, TakesAnInvalidStateOutsideSeriously) {
  guard.state(1, at(1, 0));
  guard.state(1.1, at(1.1, 2.5, false));
  EXPECT_NE(guard.objection(1.1), "");
}

// The thrust of CountsTheThrustSinceTheLastState, and a mocap whose clock is ahead.
TEST_F(Guard, AStateOfTheFutureIsOfNow) {
  for (const double ahead : {0.01, 0.5, 1.0}) {
    guard.reset();
    guard.sent(0, {0, 0});
    guard.state(1, at(1 + ahead, 1.5));
    guard.sent(1, push);
    EXPECT_EQ(guard.objection(1.2), "") << ahead;
    EXPECT_NE(guard.objection(1.5), "") << ahead;
  }
}

TEST_F(Guard, AStateOfAnotherClockIsNotValid) {
  for (const double ahead : {1.01, 1e9, kNan}) {
    guard.reset();
    guard.state(1, at(1, 1.5));
    guard.sent(1, push);
    for (double t = 1.01; t < 1.5; t += 0.01) guard.state(t, at(t + ahead, 0));
    EXPECT_NE(guard.objection(1.5), "") << "carries on from the last valid state";
    guard.reset();
    guard.state(1, at(1, 0));
    guard.state(1.1, at(1.1 + ahead, 2.5));
    EXPECT_NE(guard.objection(1.1), "") << "the craft may be there nevertheless";
  }
}

TEST_F(Guard, ForgetsAllWhenTheClockWasSet) {
  guard.state(100, at(100, 1.5));
  guard.sent(100, push);
  guard.reset();
  EXPECT_EQ(guard.objection(200), "");
  guard.state(100, at(100, 2.5));
  guard.reset();
  EXPECT_EQ(guard.objection(100), "");
  guard.state(10, at(10, 1.5));
  EXPECT_EQ(guard.objection(10.1), "");
}

TEST(Fresh, ForATimeByEachClock) {
  Freshness message;
  EXPECT_TRUE(message.stale({0, 0}, 0.2));
  message.received({10, 50}, 49.9);
  EXPECT_FALSE(message.stale({10.05, 50.05}, 0.2));
  EXPECT_TRUE(message.stale({10.05, 50.11}, 0.2)) << "by its stamp";
  EXPECT_TRUE(message.stale({10.21, 50}, 0.2)) << "though the clock of stamps stands still";
  message.reset();
  EXPECT_TRUE(message.stale({10, 50}, 0.2));
}

TEST(Fresh, NotWithAStampOfAnotherClock) {
  Freshness message;
  for (const double ahead : {1.01, kNan, std::numeric_limits<double>::infinity()}) {
    message.received({10, 50}, 50 + ahead);
    EXPECT_TRUE(message.stale({10, 50}, 0.2)) << ahead;
  }
  message.received({10, 50}, 50.99);  // clocks always differ slightly
  EXPECT_FALSE(message.stale({10.1, 50.1}, 0.2));
  EXPECT_TRUE(message.stale({10.2, 50.2}, 0.2));
}

}  // namespace fence_guard_test
}  // namespace ground
