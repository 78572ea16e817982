// A fence knows the thrust since the last state, and the speed up to which it keeps a craft inside.
#include "ground/safety/fence_bound.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <string>

#include "../crafts.h"
#include "ground/control/controllers.h"
#include "ground/control/reference_pilot.h"

namespace ground {
namespace fence_bound_test {

using Point = Vector2<double>;

RigidState<double> moving(const Point& at, double psi, double u, double v) {
  return {{at.x(), at.y(), psi}, {u, v, 0}};
}

/// Position at rest by small steps: thrusts, then gliding until the motors are off, then the floor.
Point atRest(const RigidState<double>& state, double age, const Fence::Thrusts& thrusts, const Room& room) {
  constexpr double kStep = 1e-4;
  Point at = state.eta.head<2>();
  Point velocity = bodyToWorld<double>(state.eta.z(), state.nu.head<2>().eval());
  for (double t = 0; t < age + room.latency; t += kStep) {
    double ends = 0;
    for (std::size_t i = 0; i < thrusts.size(); ++i) {
      const double begins = ends;
      ends += thrusts[i].duration + (i + 1 == thrusts.size() ? room.latency : 0);
      if (t >= begins && t < ends)
        velocity += kStep * bodyToWorld<double>(state.eta.z(), thrusts[i].acceleration);
    }
    at += kStep * velocity;
  }
  while (velocity.norm() > kStep * room.braking) {
    velocity -= kStep * room.braking * velocity.normalized();
    at += kStep * velocity;
  }
  return at;
}

TEST(FenceThrust, RestIsThatOfACraftWithThrust) {
  std::mt19937_64 random(5);
  std::uniform_real_distribution<double> uniform(-1, 1);
  const Room room;
  const Fence fence(room, room.margin);
  for (int i = 0; i < 50; ++i) {
    const RigidState<double> state =
        moving({uniform(random), uniform(random)}, 3 * uniform(random), uniform(random), uniform(random));
    const double age = 0.2 + 0.2 * uniform(random);
    Fence::Thrusts thrusts;
    for (int j = 0; j < 2; ++j)
      thrusts.push_back({{2 * uniform(random), uniform(random)}, 0.5 * age * std::abs(uniform(random))});
    EXPECT_LT((fence.stoppingPoint(state, age, thrusts, 2) - atRest(state, age, thrusts, room)).norm(), 2e-3);
    EXPECT_LT((fence.stoppingPoint(state, age, thrusts, 0) - fence.stoppingPoint(state, age)).norm(), 1e-12);
  }
}

TEST(FenceThrust, CountsOnlyTowardsAWall) {
  const Room room;
  const Fence fence(room, room.margin);
  const RigidState<double> state = moving({1.6, 0}, 0, 0.2, 0);
  EXPECT_EQ(fence.objection(state, 0.2), "");
  EXPECT_NE(fence.objection(state, 0.2, {{{2, 0}, 0.2}}), "");
  EXPECT_EQ(fence.objection(state, 0.2, {{{0.01, 0}, 0.2}}), "");
  const RigidState<double> quick = moving({1.6, 0}, 0, 1.0, 0);
  EXPECT_NE(fence.objection(quick, 0.2, {{{-2, 0}, 0.2}}), "") << "that it brakes is not relied on";
  EXPECT_NE(fence.objection(state, 0.4, {{{2, 0}, 0.2}, {{-2, 0}, 0.2}}), "");
  // A thrust that has just been replaced lasts on for the latency, as if it had not been.
  const std::string lasting = fence.objection(state, 0.15, {{{1.5, 0}, 0.15}});
  EXPECT_NE(lasting, "");
  EXPECT_EQ(fence.objection(state, 0.15, {{{1.5, 0}, 0.15}, {{0, 0}, 0}}), lasting);
}

TEST(FenceBound, FullAccelerationIsThatOfAllThrusters) {
  ReferencePilot pilot([] { return 0.0; }, nullptr);
  EXPECT_EQ(fullAcceleration(pilot, 0), 0) << "the craft is unknown";
  Model model;
  model.body.k = 0.05;
  model.body.m = 0.1;
  model.body.I_z = 1e-3;
  model.body.input_max = 0.8;
  auto controller = makeController(model, ControllerChoice());
  pilot.swapController(controller, model);
  EXPECT_NEAR(fullAcceleration(pilot, 0), 2 * 0.05 * 0.8 / 0.1, 1e-12);
}

TEST(FenceBound, FullAccelerationFollowsTheVoltage) {
  Model model = withValues(tinyWhoover(), {{"battery_voltage.p", 2}});
  model.body.volts = 7.4;
  ReferencePilot pilot([] { return 0.0; }, nullptr);
  pilot.setCraft(model);
  const double unknown = fullAcceleration(pilot, 0);
  pilot.voltage(8.4);
  EXPECT_NEAR(fullAcceleration(pilot, 0), std::pow(8.4 / 7.4, 2) * unknown, 1e-9 * unknown);
  pilot.voltage(6.6);
  EXPECT_NEAR(fullAcceleration(pilot, 0), unknown, 1e-9 * unknown) << "an effect may be wrong";
  pilot.voltage(8.4);
  for (const double implausible : {0.3, 3.7, 8400.0}) {
    pilot.voltage(implausible);
    EXPECT_NEAR(fullAcceleration(pilot, 0), std::pow(8.4 / 7.4, 2) * unknown, 1e-9 * unknown) << implausible;
  }
}

TEST(FenceBound, FallsWithAllThatGoesWrongAndIsScaleFree) {
  const Room room;
  const Upset much{0.12, 0.25, 0.2};
  const double speed = largestSafeSpeed(room, 2, much);
  EXPECT_GT(speed, 0.3);
  for (const Upset& more : {Upset{0.2, 0.25, 0.2}, Upset{0.12, 0.35, 0.2}, Upset{0.12, 0.25, 0.3}})
    EXPECT_LT(largestSafeSpeed(room, 2, more), speed);
  EXPECT_EQ(largestSafeSpeed(room, 2, {0.8, 0.25, 0.2}), 0) << "the push is stronger than the floor";
  // Ten times as large: lengths, speeds and accelerations, with the same times.
  Room large = room;
  for (Point& corner : large.corners) corner *= 10;
  large.margin *= 10;
  large.braking *= 10;
  EXPECT_NEAR(largestSafeSpeed(large, 20, much), 10 * speed, 0.1);
}

TEST(FenceBound, HoldsForACraftThatIsPushedTowardsAWall) {
  const Room room;
  const double full = 2;
  for (const Upset& upset : {Upset{0.05, 0.1, 0.1}, Upset{0.12, 0.25, 0.2}, Upset{0.2, 0.1, 0}}) {
    const double bound = largestSafeSpeed(room, full, upset);
    ASSERT_GT(bound, 0);
    const Fence fence(room, room.margin);
    for (double speed = 0; speed < bound; speed += 0.05) {
      // As near to the wall as the fence allows, with full thrust; then no pose for `blind`.
      double x = 2;
      while (!fence.objection(moving({x, 0}, 0, speed, 0), 0, {{{full, 0}, 0}}).empty()) x -= 0.001;
      const double push = upset.push * full, steps = 1e-4;
      double at = x, v = speed, fastest = v, stopped = -1;
      for (double t = 0; stopped < 0 || t < stopped + room.latency; t += steps) {
        const bool blind = t < upset.blind;
        const RigidState<double> known = blind ? moving({x, 0}, 0, speed, 0) : moving({at, 0}, 0, v, 0);
        const double age = blind ? t : 0;
        if (stopped < 0 && !fence.objection(known, age, {{{full, 0}, age}}).empty()) stopped = t;
        v += steps * (full * (1 + upset.thrust_error) + push);
        at += steps * v;
        fastest = std::max(fastest, v);
      }
      for (; v > 0; v -= steps * (room.braking - push)) at += steps * v;
      EXPECT_TRUE(fastest > bound || at < 2) << "at " << speed << " m/s, bound " << bound;
    }
  }
}

TEST(FenceBound, IsSaidInWords) {
  const std::string text = fenceBound(Room(), 2);
  EXPECT_NE(text.find("12% of full thrust, 0.25 s without poses"), std::string::npos) << text;
  EXPECT_NE(fenceBound(Room(), 0).find("without a model"), std::string::npos);
  EXPECT_NE(fenceBound(Room(), 40).find("at no speed for certain"), std::string::npos);
}

}  // namespace fence_bound_test
}  // namespace ground
