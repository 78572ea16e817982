// Whole experiments without ROS: determinism, life cycle of controllers, mocap.
#include "ground/simulation/experiment.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "../crafts.h"
#include "ground/control/input_design.h"

namespace ground {
namespace experiment_test {

Model mvwt() { return loadModel("cfg/hovercraft/mvwt.yaml"); }

/// Rest, lift from 0.5 s on, a PRBS from 1.5 s to the end.
InputSequence prbs(double end) {
  PrbsParams params;
  params.duration = end;
  const InputSignal signal = playBits({makePrbs(9, 11), 1}, params);
  InputSequence schedule;
  schedule.add(0, 0, 0, 0);
  schedule.add(0.5, 0, 0, 1);
  for (double t = 0; t + 1.5 < end; t = signal.nextChange(t))
    schedule.add(t + 1.5, signal.at(t).thrusters, 1);
  return schedule;
}

TrackingParams mvwtCircle() {
  TrackingParams tracking;
  tracking.reference.size = 1.5;
  tracking.reference.rate_of_turn = 0.3;
  static_cast<TrackingGains&>(tracking.controller) = {4, 0.6, 1.5, 1.5, -0.01, 0};  // (4.10)
  tracking.duration = 60;
  return tracking;
}

/// Largest distance of the true craft from the reference, from `settled` [s] on.
double worst(const ExperimentLog& log, double settled) {
  double largest = 0;
  auto truth = log.truth.begin();
  for (const auto& reference : log.references) {
    while (truth->time < reference.time) ++truth;
    EXPECT_EQ(truth->time, reference.time);
    if (reference.time < settled) continue;
    largest = std::max(largest, (truth->state.eta.head<2>() - reference.point.p).norm());
  }
  EXPECT_GT(log.references.back().time, settled + 10);
  return largest;
}

void expectSame(const ExperimentLog& a, const ExperimentLog& b) {
  ASSERT_EQ(a.frames.size(), b.frames.size());
  ASSERT_EQ(a.commands.size(), b.commands.size());
  ASSERT_EQ(a.truth.size(), b.truth.size());
  for (std::size_t i = 0; i < a.frames.size(); ++i) {
    EXPECT_EQ(a.frames[i].delivered, b.frames[i].delivered);
    EXPECT_EQ(a.frames[i].eta, b.frames[i].eta);
  }
  for (std::size_t i = 0; i < a.commands.size(); ++i) {
    EXPECT_EQ(a.commands[i].time, b.commands[i].time);
    EXPECT_EQ(a.commands[i].thrusters(0), b.commands[i].thrusters(0));
    EXPECT_EQ(a.commands[i].thrusters(1), b.commands[i].thrusters(1));
  }
  for (std::size_t i = 0; i < a.truth.size(); ++i) EXPECT_EQ(a.truth[i].state.nu, b.truth[i].state.nu);
}

TEST(Experiment, SameArgumentsGiveTheSameLog) {
  ExperimentParams params;
  params.mocap.loss = 0.05;
  params.mocap.gap_rate = 0.3;
  params.mocap.gap_length = 0.05;
  params.seed = 4;
  const InputSequence schedule = prbs(8);
  expectSame(playSchedule(tinyWhoover(), schedule, 8, params),
             playSchedule(tinyWhoover(), schedule, 8, params));
  TrackingParams tracking;
  tracking.duration = 8;
  const ExperimentLog tracked = trackReference(tinyWhoover(), tinyWhoover(), tracking, params);
  expectSame(tracked, trackReference(tinyWhoover(), tinyWhoover(), tracking, params));
  params.seed = 5;
  const ExperimentLog other = trackReference(tinyWhoover(), tinyWhoover(), tracking, params);
  EXPECT_NE(tracked.frames.front().eta, other.frames.front().eta);
  EXPECT_NE(tracked.truth.back().state.eta, other.truth.back().state.eta);
}

TEST(Experiment, TruthIsTheModelSimulatedWithTheCommandsOfTheLog) {
  const Model model = withValues(tinyWhoover(), {{"motor_lag.tau", 0.06}});
  ExperimentParams params;
  params.initial.eta << 0.3, -0.2, 1;
  params.initial.nu << 0.1, 0.05, -0.4;
  InputSequence schedule = prbs(6);
  schedule.lift.front() = 1;  // the floor brakes a craft without lift
  const ExperimentLog log = playSchedule(model, schedule, 6, params);
  InputSequence inputs;
  for (const auto& c : log.commands) inputs.add(c.time, c.thrusters(0), c.thrusters(1), c.lift);
  const Dynamics<double> dynamics(model);
  Simulation<double> simulation(dynamics, inputs, params.initial, 0);
  for (const auto& truth : log.truth) {
    simulation.advance(truth.time);
    EXPECT_LT((simulation.state().nu - truth.state.nu).norm(), 1e-5) << truth.time;
  }
  EXPECT_EQ(log.truth.front().state.eta, params.initial.eta);
}

TEST(Experiment, TracksACircleWithANoisyMocap) {
  // With delta_1 of (4.10), -0.01 m/s, noise of the velocity makes the craft turn wildly.
  TrackingParams tracking = mvwtCircle();
  tracking.controller.delta_1 = -0.1;
  EXPECT_LT(worst(trackReference(mvwt(), mvwt(), tracking, {}), 40), 0.1);

  // The Tiny Whoover's gains (4.11) always saturate: its error is about the size of the circle, now and then
  // more.
  tracking = {};
  tracking.duration = 60;
  tracking.max_error = INFINITY;
  std::vector<double> errors;
  for (unsigned long seed = 1; seed <= 15; ++seed) {
    ExperimentParams params;
    params.seed = seed;
    errors.push_back(worst(trackReference(tinyWhoover(), tinyWhoover(), tracking, params), 20));
  }
  std::sort(errors.begin(), errors.end());
  EXPECT_LT(errors[7], 1.0);
}

/// Rms distance from a rhodonea of a pushed craft with ModelPredictive, seen by a slow and noisy mocap [m].
double distanceOfPushed(unsigned long seed, double imu_rate) {
  const Model model = loadModel("cfg/hovercraft/tiny_whoover_4_1.yaml");
  TrackingParams tracking;
  tracking.reference.kind = "rhodonea";
  tracking.reference.size = 1.5;
  tracking.reference.petals = 1.5;
  tracking.reference.rate_of_turn = 0.4;
  tracking.controller.kind = "ModelPredictive";
  tracking.max_error = 10;
  tracking.duration = 30;
  ExperimentParams params;
  params.seed = seed;
  params.imu_rate = imu_rate;
  params.mocap.rate = 30;
  params.mocap.latency = 0.03;
  params.mocap.position_noise = tracking.estimator.position_noise = 1e-3;
  params.mocap.heading_noise = tracking.estimator.heading_noise = 1e-2;
  const double force = 2 * model.body.k, moment = model.body.k * model.body.l;
  params.disturbance.sigma = 0.02 * Vector3<double>(force, force, moment);
  params.disturbance.time.setConstant(0.5);
  const ExperimentLog log = trackReference(model, model, tracking, params);
  EXPECT_EQ(log.stopped, "");
  double squares = 0, count = 0;
  auto truth = log.truth.begin();
  for (const auto& reference : log.references) {
    while (truth->time < reference.time) ++truth;
    if (reference.time < 12) continue;
    squares += (truth->state.eta.head<2>() - reference.point.p).squaredNorm();
    ++count;
  }
  return std::sqrt(squares / count);
}

TEST(Experiment, GyroAndAccelerometerKeepAPushedCraftNearerToItsReference) {
  double without = 0, sensed = 0;
  for (const unsigned long seed : {1, 2, 3}) {
    without += distanceOfPushed(seed, 0) / 3;
    sensed += distanceOfPushed(seed, 100) / 3;
  }
  EXPECT_LT(without, 7e-3);
  EXPECT_LT(sensed, 0.8 * without);
}

TEST(Experiment, TheTrackingControllerStopsWithoutAState) {
  ExperimentParams params;
  params.mocap.gap_rate = 0.2;
  params.mocap.gap_length = 1;
  const TrackingParams tracking = mvwtCircle();
  const ExperimentLog log = trackReference(mvwt(), mvwt(), tracking, params);
  EXPECT_EQ(log.stopped, "the state is stale");
  EXPECT_LT(log.truth.back().time, 30);
  const double last_seen = log.references.back().time;
  for (const auto& c : log.commands)
    if (c.time > last_seen + 0.23) {
      EXPECT_EQ(c.thrusters(0) + c.thrusters(1), 0) << c.time;
      EXPECT_EQ(c.lift, c.time < log.stopped_at ? 1 : 0) << c.time;
    }
  const double timeout = tracking.life.state_timeout, recovery = tracking.life.recovery_time;
  EXPECT_NEAR(log.stopped_at, last_seen + timeout + recovery, 0.03);
  EXPECT_NEAR(log.truth.back().time, log.stopped_at + tracking.tail, 0.03);

  params.mocap.loss = 1;
  const ExperimentLog blind = trackReference(mvwt(), mvwt(), mvwtCircle(), params);
  EXPECT_EQ(blind.stopped, "there was no valid state to start with");
  EXPECT_TRUE(blind.frames.empty());
}

/// Pushes with twice the full thrust.
TrackingParams tooMuch() {
  TrackingParams tracking;
  tracking.law = [](const auto&, const auto&, const auto&, double) { return Eigen::Vector2d(2, 2); };
  tracking.max_error = INFINITY;
  tracking.duration = 5;
  return tracking;
}

double thrustOf(const ExperimentLog::Command& c) { return c.thrusters(0) + c.thrusters(1); }

TEST(Experiment, WhatIsSentIsWithinTheLimits) {
  const ExperimentLog log = trackReference(tinyWhoover(), tinyWhoover(), tooMuch(), {});
  EXPECT_EQ(log.stopped, "");
  EXPECT_EQ(log.decisions.back().wanted(0), 2);
  double most = 0;
  for (const auto& c : log.sent) most = std::max(most, thrustOf(c));
  EXPECT_EQ(most, 2);
}

TEST(Experiment, TheSenderCutsTheThrustOfAControllerThatDrivesWithoutAState) {
  TrackingParams tracking = tooMuch();
  tracking.life.state_timeout = 2;
  ExperimentParams params;
  params.hazards.unseen = {3, 5};
  const ExperimentLog log = trackReference(tinyWhoover(), tinyWhoover(), tracking, params);
  EXPECT_EQ(log.stopped, "the sender is not armed: the state is stale");
  const double cut = 3 + tracking.link.state_timeout, fault = cut + tracking.link.recovery_time;
  EXPECT_NEAR(log.stopped_at, fault, 0.02);
  for (const auto& c : log.commands) {
    const bool driven = c.time > 2 && c.time < log.stopped_at;
    EXPECT_TRUE(!driven || thrustOf(c) > 0) << c.time;
  }
  for (const auto& c : log.sent) {
    const bool driven = c.time > 2 && c.time<cut - 0.02, late = c.time> cut + 0.01;
    EXPECT_TRUE(!driven || thrustOf(c) > 0) << c.time;
    EXPECT_TRUE(!late || thrustOf(c) == 0) << c.time;
    EXPECT_TRUE(!late || c.lift == (c.time < log.stopped_at ? 1 : 0)) << c.time;
  }
}

TEST(Experiment, TheSenderRefusesThrustWithoutLift) {
  TrackingParams tracking = tooMuch();
  tracking.life.lift = 0;
  const ExperimentLog log = trackReference(tinyWhoover(), tinyWhoover(), tracking, {});
  EXPECT_EQ(
      log.stopped,
      "the sender is not armed: commands are stale: a command of the controller is thrust without lift");
  for (const auto& c : log.sent) EXPECT_EQ(thrustOf(c) + c.lift, 0) << c.time;
  EXPECT_EQ(log.truth.back().state.eta, log.truth.front().state.eta);
}

TEST(Experiment, WhatIsSentIsWhatTheControllerCommandsWhileNothingFails) {
  const ExperimentLog log = trackReference(mvwt(), mvwt(), mvwtCircle(), {});
  const auto driven = [](std::vector<ExperimentLog::Command> all) {
    all.erase(std::remove_if(all.begin(), all.end(), [](const auto& c) { return c.time < 2; }), all.end());
    return all;
  };
  const auto sent = driven(log.sent), given = driven(log.commands);
  ASSERT_EQ(sent.size(), given.size());
  for (std::size_t i = 0; i < sent.size(); ++i) {
    EXPECT_EQ(sent[i].time, given[i].time);
    EXPECT_EQ(sent[i].lift, given[i].lift);
    EXPECT_EQ(thrustOf(sent[i]), thrustOf(given[i]));
  }
}

TEST(Experiment, RefusesNonsense) {
  const Model model = tinyWhoover();
  InputSequence schedule;
  schedule.add(0, 1.1, 0, 1);
  EXPECT_THROW(playSchedule(model, schedule, 5, {}), std::invalid_argument);
  TrackingParams tracking;
  tracking.reference.kind = "square";
  EXPECT_THROW(trackReference(model, model, tracking, {}), std::invalid_argument);
  ExcitationParams excitation;
  excitation.design.kind = "noise";
  EXPECT_THROW(excite(model, model, excitation, {}), std::invalid_argument);
  const Model wild = withValues(model, {{"I_z", 1e-9}, {"N_r", 1}});
  EXPECT_THROW(playSchedule(wild, prbs(5), 5, {}), std::runtime_error);
}

}  // namespace experiment_test
}  // namespace ground
