// Detects by its motion whether a craft follows its commands.
#include "ground/safety/obedience_monitor.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <map>
#include <optional>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "../crafts.h"
#include "../faulty_craft.h"
#include "ground/control/input_design.h"
#include "ground/estimation/velocity_estimator.h"
#include "ground/model/measurement.h"
#include "ground/model/typical.h"
#include "ground/safety/obedience_watch.h"
#include "ground/simulation/experiment.h"

namespace ground {
namespace obedience_monitor_test {

constexpr double kTimeout = 1.0;   // the sender's default [s]
constexpr double kNever = 1e9;     // [s]
constexpr double kDeafFrom = 5.0;  // [s]

Model craft() { return tinyWhoover(); }

/// A drive by a controller or of the design prbs, with a craft that is faulty from some time on; noise of
/// x and y [m].
ExperimentLog drive(const Model& truth, const std::string& kind, double faulty_from, double duration,
                    unsigned long seed = 1, CraftFault fault = CraftFault::kDeaf,
                    double noise = MocapParams().position_noise) {
  ModelCraft::Params start;
  start.seed = seed;
  FaultyCraft plant(truth, start, fault, faulty_from);
  ExperimentParams params;
  params.seed = seed;
  params.plant = &plant;
  params.mocap.position_noise = noise;
  if (kind == "prbs") {
    ExcitationParams excitation;
    excitation.design.seed = seed;
    excitation.duration = duration;
    return excite(truth, craft(), excitation, params);
  }
  TrackingParams tracking;
  tracking.controller.kind = kind;
  tracking.duration = duration;
  tracking.reference.size = 1.5;
  tracking.reference.rate_of_turn = 0.4;
  return trackReference(truth, craft(), tracking, params);
}

/// Time at which a monitor with the nominal model first reports the craft of a log [s], and its
/// reason; 0 if never.
double reportedAt(const ExperimentLog& log, std::string* reason = nullptr) {
  const Model model = craft();
  ObedienceMonitor monitor(model);
  VelocityEstimator estimator({});
  std::size_t next = 0;
  for (const MocapFrame& frame : log.frames) {
    for (; next < log.commands.size() && log.commands[next].time <= frame.delivered; ++next)
      monitor.command(log.commands[next].time,
                      {log.commands[next].thrusters(0), log.commands[next].thrusters(1)},
                      log.commands[next].lift);
    const StateEstimate& e = estimator.update(frame.captured, frame.eta);
    if (!e.valid || !e.used) continue;
    monitor.measure(frame.captured, {e.eta, e.nu}, e.nu_covariance.diagonal());
    const std::string found = monitor.disobedience(kTimeout);
    if (found.empty()) continue;
    if (reason) *reason = found;
    return frame.delivered;
  }
  return 0;
}

double reportedAfter(const Model& truth, const std::string& controller, unsigned long seed = 1) {
  const ExperimentLog log = drive(truth, controller, kDeafFrom, kDeafFrom + 3, seed);
  if (controller == "prbs") {
    const double at = reportedAt(log);
    return at == 0 ? kNever : at - kDeafFrom;
  }
  // The controller stops by itself.
  EXPECT_NE(log.stopped.find("the craft does not follow its commands"), std::string::npos) << log.stopped;
  return log.stopped_at - kDeafFrom;
}

class Obedience : public testing::TestWithParam<const char*> {};

TEST_P(Obedience, ADeafCraftIsReportedWithinOneAndAHalfSeconds) {
  for (unsigned long seed : {1ul, 2ul, 3ul}) {
    const double after = reportedAfter(craft(), GetParam(), seed);
    EXPECT_GT(after, 0.5);  // its motors stop by themselves after 0.25 s
    EXPECT_LT(after, 1.5);
  }
}

TEST_P(Obedience, AnObedientCraftIsNotReported) {
  EXPECT_EQ(reportedAt(drive(craft(), GetParam(), kNever, 20)), 0);
}

TEST_P(Obedience, PosesNoisierThanAssumedGiveNoFalseReport) {
  for (double noise : {1e-3, 1.5e-3})
    for (unsigned long seed = 1; seed <= 6; ++seed) {
      const ExperimentLog log = drive(craft(), GetParam(), kNever, 8, seed, CraftFault::kDeaf, noise);
      EXPECT_EQ(log.stopped + "|" + std::to_string(reportedAt(log)), "|" + std::to_string(0.0))
          << 1e3 * noise << " mm, seed " << seed;
    }
}

TEST_P(Obedience, AModelWrongByAFactorOfTwoGivesNoFalseReport) {
  for (double factor : {0.5, 2.0}) {
    Model truth = craft();
    truth.body.k *= factor;
    EXPECT_EQ(reportedAt(drive(truth, GetParam(), kNever, 10)), 0) << "thrust " << factor;
    EXPECT_LT(reportedAfter(truth, GetParam()), 2.5) << "thrust " << factor;
    truth = craft();
    truth.body.X_u *= factor;
    truth.body.Y_v *= factor;
    truth.body.N_r *= factor;
    EXPECT_EQ(reportedAt(drive(truth, GetParam(), kNever, 10)), 0) << "damping " << factor;
  }
}

TEST_P(Obedience, EffectsMissingInTheModelGiveNoFalseReport) {
  const std::map<std::string, double> values = {{"motor_lag.tau", 0.06},
                                                {"input_delay.delay", 0.15},
                                                {"thrust_asymmetry.a", 0.2},
                                                {"coulomb_friction.f", 0.01},
                                                {"floor_tilt.sx", 0.02}};
  for (const auto& [name, value] : values) {
    const Model truth = withValues(craft(), {{name, value}});
    EXPECT_EQ(reportedAt(drive(truth, GetParam(), kNever, 8)), 0) << name;
  }
}

TEST_P(Obedience, ATrimGivesNoFalseReport) {
  const Model truth = withValues(craft(), {{"yaw_bias.n0", 2e-4}});
  for (unsigned long seed : {1ul, 2ul, 3ul})
    EXPECT_EQ(reportedAt(drive(truth, GetParam(), kNever, 15, seed)), 0) << "seed " << seed;
}

struct Named {
  const char* name;
  CraftFault fault;
  const char* words;
};
std::string nameOf(const testing::TestParamInfo<Named>& info) { return info.param.name; }

class FaultNamed : public testing::TestWithParam<Named> {};

TEST_P(FaultNamed, WithinAboutASecondAndTheControllerStops) {
  for (unsigned long seed : {1ul, 2ul, 3ul}) {
    const ExperimentLog log =
        drive(craft(), "ModelPredictive", kDeafFrom, kDeafFrom + 4, seed, GetParam().fault);
    EXPECT_NE(log.stopped.find(GetParam().words), std::string::npos) << log.stopped;
    EXPECT_LT(log.stopped_at - kDeafFrom, 1.5);
  }
}

INSTANTIATE_TEST_SUITE_P(, FaultNamed,
                         testing::Values(Named{"Swapped", CraftFault::kSwapped, "swapped"},
                                         Named{"LeftOff", CraftFault::kLeftOff, "the left thruster"},
                                         Named{"RightOff", CraftFault::kRightOff, "the right thruster"},
                                         Named{"NoLift", CraftFault::kNoLift, "without lift"}),
                         nameOf);

INSTANTIATE_TEST_SUITE_P(, Obedience, testing::Values("prbs", "ModelPredictive"));

/// The monitor's reason for a craft that plays a PRBS and collides at `at` [s]; `change` is the
/// change of its velocities by the collision.
std::string reasonAfterCollision(double at, const Vector3<double>& change) {
  const Model model = craft();
  const Dynamics<double> dynamics(model);
  ObedienceMonitor monitor(model);
  InputSequence inputs;
  const InputSignal signal = makeDesign({}, 20);
  Simulation<double> simulation(dynamics, inputs, {}, 0);
  for (int i = 0; i < 2000; ++i) {
    const double now = 0.01 * i;
    const Thrusters<double> thrusters = signal.at(now).thrusters;
    inputs.add(now, thrusters, 1);
    monitor.command(now, thrusters, 1);
    simulation.advance(now);
    if (now >= at && now < at + 0.005) simulation.state().nu += change;
    monitor.measure(now, simulation.state(), {1e-4, 1e-4, 1e-2});
    const std::string reason = monitor.disobedience(kTimeout);
    if (!reason.empty()) return reason;
  }
  return "";
}

TEST(ObedienceMonitor, ACollisionIsNotReported) {
  for (double speed : {0.3, 1.0, 3.0})
    for (double at = 5; at < 15; at += 0.7)
      EXPECT_EQ(reasonAfterCollision(at, {-speed, 0, 5 * speed}), "") << speed << " m/s at " << at;
}

TEST(ObedienceMonitor, ACraftAtRestUnderFullThrustIsReportedUntilReset) {
  ObedienceMonitor monitor(craft());
  double reported_at = 0;
  for (int i = 0; i < 300 && reported_at == 0; ++i) {
    monitor.command(0.01 * i, {1, 1}, 1);
    monitor.measure(0.01 * i, {}, Vector3<double>::Constant(1e-4));
    if (!monitor.disobedience(1).empty()) reported_at = 0.01 * i;
  }
  EXPECT_GT(reported_at, 0.5);
  EXPECT_LT(reported_at, 1.1);
  monitor.reset();
  EXPECT_EQ(monitor.disobedience(1), "");
}

/// A craft under random commands, and the watch of a sender that is armed.
class WatchedFlight {
 public:
  explicit WatchedFlight(const Model& believed) : watch_(believed), truth_(believed) {
    watch_.setTimeout(kTimeout);
  }

  /// The force of each thruster from now on, over that of the model.
  void setShares(const Thrusters<double>& shares) { shares_ = shares; }
  std::optional<double> volts;  ///< of the battery [V]
  ObedienceWatch& watch() { return watch_; }
  /// Flies for `duration` [s]; returns when and what the watch first reported [s since now], or infinity.
  std::pair<double, std::string> fly(double duration, bool armed = true) {
    const double began = time_;
    std::uniform_real_distribution<double> level(0, 1);
    std::normal_distribution<double> normal;
    const ThrusterLayout& layout = *truth_.thrusters;
    const Vector3<double> noise(0.005, 0.005, 0.02);
    for (int i = 0; i < std::lround(100 * duration); ++i) {
      if (i % 50 == 0)
        for (int j = 0; j < layout.size(); ++j) held_.thrusters(j) = layout[j].most * level(random_);
      if (armed) drive_.command(time_, held_.lift);
      watch_.sent(time_, armed, held_, drive_);
      Thrusters<double> forced = held_.thrusters;
      for (int j = 0; j < layout.size(); ++j) forced(j) *= shares_(j);
      double t = drive_.since(time_);
      const Dynamics<double> dynamics(truth_);
      dynamics.step(t, state_, dynamics.actuate(forced, {1, volts}, 0.01, nullptr), 0.01);
      time_ += 0.01;
      RigidState<double> seen = state_;
      for (int j = 0; j < 3; ++j) seen.nu(j) += noise(j) * normal(random_);
      const std::string found = watch_.measured(time_, seen, noise.cwiseAbs2());
      if (!found.empty()) return {time_ - began, found};
    }
    return {std::numeric_limits<double>::infinity(), ""};
  }

 private:
  ObedienceWatch watch_;
  Model truth_;
  std::mt19937 random_{3};
  Thrusters<double> shares_ = Thrusters<double>::filled(truth_.thrusters->size(), 1);
  Inputs held_ = Inputs::off(truth_.thrusters->size(), 1);
  RigidState<double> state_;
  double time_ = 10;
  DriveClock drive_;
};

TEST(ObedienceWatch, KnowsTheVoltageThatTheCraftReports) {
  Model model = withValues(craft(), {{"battery_voltage.p", 5}});
  model.body.volts = 7.4;
  for (const bool told : {false, true}) {
    WatchedFlight flight(model);
    flight.volts = 4.8;  // a tenth of the thrust
    if (told) flight.watch().voltage(*flight.volts);
    EXPECT_EQ(std::isinf(flight.fly(20).first), told);
  }
}

// Thrust fades to an eighth. Who takes the next arming for the start of the drive expects all of it.
TEST(ObedienceWatch, KnowsADriveThatBeganBeforeTheArming) {
  WatchedFlight flight(withValues(craft(), {{"battery_sag.tau", 20}}));
  ASSERT_EQ(flight.fly(40).second, "");
  flight.fly(0.5, false);
  EXPECT_EQ(flight.fly(5).second, "");
}

TEST(ObedienceWatch, NamesADeadThrusterOfManyUntilTheNextArming) {
  const Model model = loadModel("cfg/craft/air_table.yaml");
  WatchedFlight flight(model);
  ASSERT_EQ(flight.fly(5).second, "");
  Thrusters<double> shares = Thrusters<double>::filled(8, 1);
  shares(2) = 0;
  flight.setShares(shares);
  const std::string what = flight.fly(20).second;
  EXPECT_NE(what.find("front_left_back thruster were off"), std::string::npos) << what;
  flight.setShares(Thrusters<double>::filled(8, 1));
  flight.fly(0.5, false);
  EXPECT_EQ(flight.fly(10).second, "");
}

}  // namespace obedience_monitor_test
}  // namespace ground
