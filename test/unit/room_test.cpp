// The simulated room: determinism, mocap quality, the craft's watchdog.
#include "ground/simulation/room.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "ground/model/effect_registry.h"
#include "ground/model/model_file.h"

namespace ground {
namespace {

Model tinyWhoover() { return loadModel("cfg/hovercraft/tiny_whoover.yaml"); }

MocapParams perfect() {
  MocapParams mocap;
  mocap.position_noise = mocap.heading_noise = mocap.latency = 0;
  return mocap;
}

/// Ten seconds of PRBS-like commands, asked for in steps of `tick`.
std::vector<MocapFrame> experiment(const MocapParams& mocap, unsigned long seed, double tick) {
  Room::Params params;
  params.seed = seed;
  Room room(tinyWhoover(), mocap, params);
  std::vector<MocapFrame> all;
  for (int i = 0; i < 100; ++i) {
    room.command(i % 3 > 0, i % 5 > 2, 1);
    for (double t = tick; t < 0.1 - 1e-9; t += tick) room.advance(0.1 * i + t);
    room.advance(0.1 * (i + 1));
    for (const MocapFrame& frame : room.takeFrames()) all.push_back(frame);
  }
  return all;
}

TEST(Room, SameSeedGivesTheSameRun) {
  MocapParams mocap;
  mocap.loss = 0.1;
  mocap.gap_rate = 0.5;
  const auto a = experiment(mocap, 5, 0.1), b = experiment(mocap, 5, 0.1);
  const auto other = experiment(mocap, 6, 0.1);
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i) {
    EXPECT_EQ(a[i].captured, b[i].captured);
    EXPECT_EQ(a[i].eta, b[i].eta);
  }
  EXPECT_NE(a.front().eta, other.front().eta);
}

TEST(Room, DoesNotDependOnHowOftenItIsAdvanced) {
  const auto a = experiment(MocapParams(), 5, 0.1), b = experiment(MocapParams(), 5, 0.0013);
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i) {
    EXPECT_DOUBLE_EQ(a[i].captured, b[i].captured);
    EXPECT_LT((a[i].eta - b[i].eta).norm(), 5e-6);
  }
}

TEST(Room, FramesComeAtTheirRateWithLatencyAndNoise) {
  MocapParams mocap;
  mocap.position_noise = 1e-3;
  mocap.heading_noise = 1e-2;
  mocap.latency = 0.03;
  Room room(tinyWhoover(), mocap, {});
  std::vector<MocapFrame> frames;
  Vector3<double> square = Vector3<double>::Zero();
  for (int i = 1; i <= 5000; ++i) {
    room.advance(i * 0.01);
    for (const MocapFrame& frame : room.takeFrames()) {
      EXPECT_GE(room.time(), frame.captured + 0.03);
      square += frame.eta.cwiseAbs2();  // the craft stands still
      frames.push_back(frame);
    }
  }
  ASSERT_NEAR(frames.size(), 4998, 2);
  EXPECT_NEAR(std::sqrt(square.x() / frames.size()), 1e-3, 5e-5);
  EXPECT_NEAR(std::sqrt(square.y() / frames.size()), 1e-3, 5e-5);
  EXPECT_NEAR(std::sqrt(square.z() / frames.size()), 1e-2, 5e-4);
}

TEST(Room, LosesTheShareOfFramesAskedFor) {
  MocapParams mocap = perfect();
  mocap.loss = 0.2;
  EXPECT_NEAR(experiment(mocap, 1, 0.1).size(), 800, 60);
  mocap.loss = 0;
  mocap.gap_rate = 1;
  mocap.gap_length = 0.25;
  const auto frames = experiment(mocap, 1, 0.1);
  EXPECT_NEAR(frames.size(), 1000 / 1.25, 150);
  double longest = 0;
  for (std::size_t i = 1; i < frames.size(); ++i)
    longest = std::max(longest, frames[i].captured - frames[i - 1].captured);
  EXPECT_GT(longest, 0.25);
  mocap.loss = 1;
  EXPECT_TRUE(experiment(mocap, 1, 0.1).empty());
}

TEST(Room, WatchdogStopsTheMotorsOfACraftLeftAlone) {
  Room room(tinyWhoover(), perfect(), {});
  EXPECT_TRUE(room.watchdogExpired());
  room.command(1, 1, 1);
  room.advance(0.2);
  EXPECT_FALSE(room.watchdogExpired());
  EXPECT_GT(room.derivative().nu.x(), 1.0);
  room.advance(0.3);
  EXPECT_TRUE(room.watchdogExpired());
  EXPECT_LT(room.derivative().nu.x(), 0);  // only damping is left
  const Body<double> b = tinyWhoover().body;
  const double at_stop = 2 * b.k / b.X_u * (1 - std::exp(-b.X_u / b.m * 0.25));
  EXPECT_NEAR(room.state().nu.x(), at_stop * std::exp(-b.X_u / b.m * 0.05), 1e-9);
}

TEST(Room, MeasuresThroughTheModelsMeasurementEffects) {
  Model model = tinyWhoover();
  model.addEffect(makeEffect("heading_offset"));
  model.setValue("heading_offset.psi0", 0.5);
  Room room(model, perfect(), {});
  room.advance(0.1);
  EXPECT_DOUBLE_EQ(room.takeFrames().front().eta.z(), 0.5);
}

TEST(Room, AnotherModelTakesOverInMidFlight) {
  Model biased = tinyWhoover();
  biased.addEffect(makeEffect("body_force_bias"));
  biased.setValue("body_force_bias.x0", 0.01);
  Model broken = tinyWhoover();
  broken.body.m = 1e-320;
  Room room(tinyWhoover(), perfect(), {});
  room.command(1, 0.4, 1);
  room.advance(0.2);
  const RigidState<double> before = room.state(), rate = room.derivative();
  EXPECT_THROW(room.setModel(broken), std::invalid_argument);
  EXPECT_EQ(room.derivative().nu, rate.nu);
  room.setModel(biased);
  EXPECT_EQ(room.state().eta, before.eta);
  EXPECT_EQ(room.state().nu, before.nu);
  const Vector3<double> more = room.derivative().nu - rate.nu;
  EXPECT_NEAR(more.x(), 0.01 / biased.body.m, 1e-9);
  EXPECT_NEAR(more.y(), 0, 1e-12);
  // Inputs stay the same parts of the largest one.
  Model scaled = tinyWhoover();
  scaled.body.input_max = 2;
  scaled.body.k /= 2;
  room.setModel(tinyWhoover());
  room.setModel(scaled);
  EXPECT_NEAR((room.derivative().nu - rate.nu).norm(), 0, 1e-9);
  room.advance(0.3);
  EXPECT_TRUE(room.state().eta.allFinite());
}

TEST(Room, TimeOfTheModelBeginsWithTheDriveWhateverTheClockSays) {
  Model sagging = tinyWhoover();
  sagging.addEffect(makeEffect("battery_sag"));
  sagging.setValue("battery_sag.tau", 64);
  // After 0 s or a quarter of an hour at rest two seconds of full thrust are the same.
  const auto drive = [&](double start, double rest, bool reload) {
    Room::Params params;
    params.start = start;
    Room room(sagging, perfect(), params);
    room.advance(start + rest);
    for (int i = 0; i < 100; ++i) {
      room.command(1, 1, 1);
      room.advance(start + rest + (i + 1) * 0.02);
      if (reload && i == 50) room.setModel(sagging);
    }
    return room.state().nu.x();
  };
  const double speed = drive(0, 0, false);
  EXPECT_GT(speed, 3.5);
  EXPECT_NEAR(drive(1000, 0, false), speed, 1e-6);
  EXPECT_NEAR(drive(1000, 900, false), speed, 1e-6);
  EXPECT_NEAR(drive(1000, 0, true), speed, 1e-6);
}

TEST(Room, RefusesNonsense) {
  MocapParams bad;
  bad.latency = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(Room(tinyWhoover(), bad, {}), std::invalid_argument);
  Room room(tinyWhoover(), perfect(), {});
  room.advance(1.0);
  EXPECT_THROW(room.advance(0.5), std::invalid_argument);
  EXPECT_THROW(room.command(NAN, 0, 0), std::invalid_argument);
  room.command(9, -1, 3);  // clipped
  room.advance(1.1);
  EXPECT_NEAR(room.derivative().nu.x(), 0.062 / 0.0583, 0.05);
}

TEST(Room, ForgetsOldCommandsAndMovesOn) {
  // The same commands twice: often enough to be forgotten, and held for as long in one piece.
  Model model = loadModel("cfg/hovercraft/tiny_whoover.yaml");
  model.addEffect(makeEffect("motor_lag"));
  model.setValue("motor_lag.tau", 0.05);
  model.addEffect(makeEffect("input_delay"));
  model.setValue("input_delay.delay", 0.03);
  Room often(model, {}, {}), seldom(model, {}, {});
  constexpr int kTimes = 50000, kHeld = 250;
  for (int i = 0; i < kTimes; ++i) {
    const double left = (i / kHeld) % 2, right = (i / kHeld / 2) % 2;
    often.command(left, right, 1);
    if (i % (kHeld / 5) == 0) seldom.command(left, right, 1);
    often.advance((i + 1) * 0.001);
    seldom.advance((i + 1) * 0.001);
  }
  EXPECT_LT((often.state().eta - seldom.state().eta).norm(), 1e-6);
  EXPECT_LT((often.state().nu - seldom.state().nu).norm(), 1e-6);
  EXPECT_NO_THROW(often.setModel(model));
}

}  // namespace
}  // namespace ground

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
