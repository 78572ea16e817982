// The simulated room: determinism, mocap quality, the craft's watchdog.
#include "ground/simulation/simulated_lab.h"

#include <gtest/gtest.h>

#include <cmath>

#include "../crafts.h"

namespace ground {
namespace simulated_lab_test {

MocapParams perfect() {
  MocapParams mocap;
  mocap.position_noise = mocap.heading_noise = mocap.latency = 0;
  return mocap;
}

/// Ten seconds of PRBS-like commands; the room is advanced in steps of `tick` [s].
std::vector<MocapFrame> experiment(const MocapParams& mocap, unsigned long seed, double tick) {
  SimulatedLab::Params params;
  params.seed = seed;
  ModelCraft craft(tinyWhoover(), params);
  SimulatedLab room(craft, mocap, params);
  std::vector<MocapFrame> all;
  for (int i = 0; i < 100; ++i) {
    room.command(i % 3 > 0, i % 5 > 2, 1);
    for (double t = tick; t < 0.1 - 1e-9; t += tick) room.advance(0.1 * i + t);
    room.advance(0.1 * (i + 1));
    for (const MocapFrame& frame : room.takeFrames()) all.push_back(frame);
  }
  return all;
}

TEST(SimulatedLab, SameSeedGivesTheSameRun) {
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

TEST(SimulatedBattery, SagsUnderLoadAndByTheChargeThatWasDrawn) {
  Model model = withValues(tinyWhoover(), {{"battery_voltage.p", 2}});
  SimulatedLab::Params params;
  params.battery.endurance = 100;
  EXPECT_THROW(ModelCraft(model, params), std::invalid_argument) << "k holds at an unknown voltage";
  model.body.volts = 7.4;
  ModelCraft craft(model, params);
  const double rested = craft.voltage();
  EXPECT_NEAR(rested, 8.4, 1e-9);
  craft.command({1.0, 1.0}, 1);
  const double loaded = craft.voltage();
  EXPECT_LT(loaded, rested);
  const double full = 2 * model.body.k / model.body.m * std::pow(loaded / 7.4, 2);
  craft.advance(1e-3);
  EXPECT_NEAR(craft.derivative().nu.x(), full, 1e-3 * full);
  craft.advance(40);
  craft.command({0.0, 0.0}, 0);
  EXPECT_NEAR(craft.voltage(), 8.4 - 0.4 * 1.8, 1e-9);
  ModelCraft without(model, {});
  EXPECT_EQ(without.voltage(), 0);
}

TEST(SimulatedLab, FramesComeAtTheirRateWithLatencyAndNoise) {
  MocapParams mocap;
  mocap.position_noise = 1e-3;
  mocap.heading_noise = 1e-2;
  mocap.latency = 0.03;
  ModelCraft craft(tinyWhoover(), {});
  SimulatedLab room(craft, mocap, {});
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

TEST(SimulatedLab, WatchdogStopsTheMotorsWithoutCommands) {
  ModelCraft craft(tinyWhoover(), {});
  SimulatedLab room(craft, perfect(), {});
  EXPECT_TRUE(room.watchdogExpired());
  room.command(1, 1, 1);
  room.advance(0.2);
  EXPECT_FALSE(room.watchdogExpired());
  EXPECT_GT(room.derivative().nu.x(), 1.0);
  room.advance(0.3);
  EXPECT_TRUE(room.watchdogExpired());
  const Body<double> b = tinyWhoover().body;
  const double at_stop = 2 * b.k / b.X_u * (1 - std::exp(-b.X_u / b.m * 0.25));
  const double braking = SimulatedLab::Params().braking;  // and damping
  EXPECT_NEAR(room.state().nu.x(), at_stop - 0.05 * braking, 0.05 * at_stop * b.X_u / b.m);
  EXPECT_NEAR(room.derivative().nu.x(), -braking, room.state().nu.x() * b.X_u / b.m + 1e-9);
  room.advance(0.3 + at_stop / braking);
  EXPECT_EQ(room.state().nu, Vector3<double>::Zero());
  EXPECT_EQ(room.derivative().nu, Vector3<double>::Zero());
}

TEST(SimulatedLab, ACraftWithoutLiftSlidesStraightToRestAndStaysThere) {
  SimulatedLab::Params params;
  params.initial.nu << 0.6, -0.4, 3;
  params.disturbance.time.setConstant(0.3);
  params.disturbance.sigma = {0.02, 0.02, 5e-4};  // less than friction holds
  ModelCraft craft(tinyWhoover(), params);
  SimulatedLab room(craft, perfect(), params);
  room.command(0, 0, 1);
  room.command(0, 0, 0);
  const double speed = params.initial.nu.head<2>().norm();
  room.advance(2);
  const Vector3<double> rest = room.state().eta;
  EXPECT_NEAR(rest.head<2>().norm(), speed * speed / (2 * params.braking), 0.04);
  for (int i = 0; i < 20; ++i) {
    room.command(0, 0, 0);
    room.advance(2 + 0.2 * (i + 1));
  }
  EXPECT_LT((room.state().eta - rest).norm(), 1e-3);
  room.command(1, 1, 1);
  room.advance(6.2);
  EXPECT_GT(room.state().nu.x(), 0.2) << "lift frees it";
}

TEST(SimulatedLab, TheModelCanBeReplacedDuringARun) {
  const Model biased = withValues(tinyWhoover(), {{"body_force_bias.x0", 0.01}});
  Model broken = tinyWhoover();
  broken.body.m = 1e-320;
  ModelCraft craft(tinyWhoover(), {});
  SimulatedLab room(craft, perfect(), {});
  room.command(1, 0.4, 1);
  room.advance(0.2);
  const RigidState<double> before = room.state(), rate = room.derivative();
  EXPECT_THROW(craft.setModel(broken), std::invalid_argument);
  EXPECT_EQ(room.derivative().nu, rate.nu);
  craft.setModel(biased);
  EXPECT_EQ(room.state().eta, before.eta);
  EXPECT_EQ(room.state().nu, before.nu);
  const Vector3<double> more = room.derivative().nu - rate.nu;
  EXPECT_NEAR(more.x(), 0.01 / biased.body.m, 1e-9);
  EXPECT_NEAR(more.y(), 0, 1e-12);
  // Inputs stay the same fractions of input_max.
  Model scaled = tinyWhoover();
  scaled.body.input_max = 2;
  scaled.body.k /= 2;
  craft.setModel(tinyWhoover());
  craft.setModel(scaled);
  EXPECT_NEAR((room.derivative().nu - rate.nu).norm(), 0, 1e-9);
  room.advance(0.3);
  EXPECT_TRUE(room.state().eta.allFinite());
}

Disturbance pushes() {
  Disturbance disturbance;
  disturbance.sigma << 0.01, 0.02, 1e-4;
  disturbance.time << 0.3, 0.1, 1.0;
  return disturbance;
}

/// Mean square of each channel, and its correlation over k steps.
struct Moments {
  Vector3<double> variance, correlation;
};

Moments momentsOf(DisturbanceSource& source, int steps, int k) {
  std::vector<Vector3<double>> all;
  for (int i = 0; i < steps; ++i) all.push_back(source.next());
  Moments found{Vector3<double>::Zero(), Vector3<double>::Zero()};
  for (int i = 0; i < steps; ++i) found.variance += all[i].cwiseAbs2() / steps;
  for (int i = k; i < steps; ++i) found.correlation += all[i].cwiseProduct(all[i - k]) / (steps - k);
  found.correlation = found.correlation.cwiseQuotient(found.variance);
  return found;
}

TEST(DisturbanceSource, HasTheGivenDeviationAndCorrelation) {
  constexpr double kStep = 0.005;
  constexpr int kSteps = 400000, kLag = 40;  // 0.2 s
  const Disturbance given = pushes();
  DisturbanceSource source(given, kStep, 3);
  const Moments found = momentsOf(source, kSteps, kLag);
  for (int i = 0; i < 3; ++i) {
    const double a = std::exp(-kStep / given.time(i)), b = a * a;
    // Standard errors of the variance and, by Bartlett's formula, of a correlation.
    const double of_variance = std::sqrt(2 * (1 + b) / (1 - b) / kSteps);
    const double of_correlation =
        std::sqrt(((1 + b) * (1 - std::pow(b, kLag)) / (1 - b) - 2 * kLag * std::pow(b, kLag)) / kSteps);
    EXPECT_LT(of_variance, 0.1);
    EXPECT_NEAR(found.variance(i) / (given.sigma(i) * given.sigma(i)), 1, 3 * of_variance) << i;
    EXPECT_NEAR(found.correlation(i), std::exp(-0.2 / given.time(i)), 3 * of_correlation) << i;
  }
}

TEST(SimulatedLab, ADisturbanceActsAsAForce) {
  SimulatedLab::Params params;
  params.disturbance.trim << 0.01, 0.01, 5e-5;
  params.disturbance.trim_thrust = 0.1;
  const Model model = withValues(tinyWhoover(), {{"com_offset.xg", 0.005}});  // couples sway and yaw
  ModelCraft craft(model, params);
  SimulatedLab room(craft, perfect(), params);
  room.command(1, 0.6, 1);
  room.advance(1e-3);
  const Vector3<double> wrench = room.wrench();
  EXPECT_GT(wrench.cwiseAbs().minCoeff(), 0);
  // A model that has this force as an effect, and the thrust of this run, moves in the same way.
  Model same = withValues(
      model,
      {{"body_force_bias.x0", wrench.x()}, {"body_force_bias.y0", wrench.y()}, {"yaw_bias.n0", wrench.z()}});
  same.body.k *= DisturbanceSource(params.disturbance, kDefaultStep, params.seed).thrustFactor();
  EXPECT_GT(std::abs(same.body.k / model.body.k - 1), 1e-3);
  ModelCraft other_craft(same, {});
  SimulatedLab other(other_craft, perfect(), {});
  other.command(1, 0.6, 1);
  other.advance(1e-3);
  EXPECT_LT((room.derivative().nu - other.derivative().nu).norm(), 1e-2);
  for (SimulatedLab* one : {&room, &other}) one->advance(0.2);
  EXPECT_LT((room.state().eta - other.state().eta).norm(), 1e-5);
  EXPECT_LT((room.state().nu - other.state().nu).norm(), 2e-4);
}

}  // namespace simulated_lab_test
}  // namespace ground
