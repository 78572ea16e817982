// Detects by its motion whether a craft follows its commands.
#include "ground/estimation/obedience_monitor.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "ground/control/prbs.h"
#include "ground/estimation/velocity_estimator.h"
#include "ground/model/effect_registry.h"
#include "ground/model/measurement.h"
#include "ground/model/model_file.h"
#include "ground/model/typical.h"
#include "ground/simulation/experiment.h"

namespace ground {
namespace {

constexpr double kTimeout = 1.0;   // the sender's default [s]
constexpr double kNever = 1e9;     // [s]
constexpr double kDeafFrom = 5.0;  // [s]

Model craft() { return loadModel("cfg/hovercraft/tiny_whoover.yaml"); }

ExperimentLog drive(const Model& truth, const std::string& controller, double deaf_from,
                    double deaf_until, double duration, unsigned long seed = 1,
                    CraftFault fault = CraftFault::kDeaf) {
  TrackingParams tracking;
  tracking.controller.kind = controller;
  tracking.controller.prbs.duration = tracking.duration = duration;
  tracking.controller.prbs_seed = seed;
  tracking.reference.size = 1.5;
  tracking.reference.rate_of_turn = 0.4;
  ExperimentParams params;
  params.seed = seed;
  params.fault = fault;
  params.fault_from = deaf_from;
  params.fault_until = deaf_until;
  return trackReference(truth, craft(), tracking, params);
}

/// Time at which a monitor with the nominal model first reports the craft of a log [s], and its
/// reason; 0 if never.
double reportedAt(const ExperimentLog& log, std::string* reason = nullptr) {
  const Model model = craft();
  ObedienceMonitor monitor(model);
  const auto estimator = makeKalmanEstimator({});
  std::size_t next = 0;
  for (const MocapFrame& frame : log.frames) {
    for (; next < log.commands.size() && log.commands[next].time <= frame.delivered; ++next)
      monitor.command(log.commands[next].time,
                      {log.commands[next].thrusters(0), log.commands[next].thrusters(1)},
                      log.commands[next].lift);
    const StateEstimate& e = estimator->update(frame.captured, frame.eta);
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
  const ExperimentLog log = drive(truth, controller, kDeafFrom, kNever, kDeafFrom + 3, seed);
  if (controller == "OpenLoopPRBS") {
    const double at = reportedAt(log);
    return at == 0 ? kNever : at - kDeafFrom;
  }
  // The controller stops by itself.
  EXPECT_NE(log.stopped.find("the craft does not follow its commands"), std::string::npos)
      << log.stopped;
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
  EXPECT_EQ(reportedAt(drive(craft(), GetParam(), kNever, kNever, 20)), 0);
}

TEST_P(Obedience, AModelWrongByAFactorOfTwoGivesNoFalseReport) {
  for (double factor : {0.5, 2.0}) {
    Model truth = craft();
    truth.body.k *= factor;
    EXPECT_EQ(reportedAt(drive(truth, GetParam(), kNever, kNever, 10)), 0) << "thrust " << factor;
    EXPECT_LT(reportedAfter(truth, GetParam()), 2.5) << "thrust " << factor;
    truth = craft();
    truth.body.X_u *= factor;
    truth.body.Y_v *= factor;
    truth.body.N_r *= factor;
    EXPECT_EQ(reportedAt(drive(truth, GetParam(), kNever, kNever, 10)), 0) << "damping " << factor;
  }
}

TEST_P(Obedience, AShortLossIsNotReported) {
  EXPECT_EQ(reportedAt(drive(craft(), GetParam(), kDeafFrom, kDeafFrom + 0.5, kDeafFrom + 4)), 0);
}

TEST_P(Obedience, EffectsMissingInTheModelGiveNoFalseReport) {
  const std::map<std::string, std::map<std::string, double>> effects = {
      {"motor_lag", {{"tau", 0.06}}},
      {"input_delay", {{"delay", 0.15}}},
      {"thrust_asymmetry", {{"a", 0.2}}},
      {"coulomb_friction", {{"f", 0.01}}},
      {"floor_tilt", {{"sx", 0.02}}}};
  for (const auto& [name, values] : effects) {
    Model truth = craft();
    truth.addEffect(makeEffect(name));
    for (const auto& [parameter, value] : values) truth.setValue(name + "." + parameter, value);
    EXPECT_EQ(reportedAt(drive(truth, GetParam(), kNever, kNever, 8)), 0) << name;
  }
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
    const ExperimentLog log = drive(craft(), "ModelPredictive", kDeafFrom, kNever, kDeafFrom + 4,
                                    seed, GetParam().fault);
    EXPECT_NE(log.stopped.find(GetParam().words), std::string::npos) << log.stopped;
    EXPECT_LT(log.stopped_at - kDeafFrom, 1.5);
  }
}

TEST_P(FaultNamed, ByTheMonitorAlone) {
  for (unsigned long seed : {1ul, 2ul, 3ul}) {
    std::string reason;
    const ExperimentLog log = drive(craft(), "OpenLoopPRBS", kDeafFrom, kNever, kDeafFrom + 4, seed,
                                    GetParam().fault);
    EXPECT_GT(reportedAt(log, &reason), kDeafFrom);
    EXPECT_NE(reason.find(GetParam().words), std::string::npos) << reason;
  }
}

INSTANTIATE_TEST_SUITE_P(, FaultNamed,
                         testing::Values(Named{"Swapped", CraftFault::kSwapped, "swapped"},
                                         Named{"LeftOff", CraftFault::kLeftOff, "the left thruster"},
                                         Named{"RightOff", CraftFault::kRightOff, "the right thruster"},
                                         Named{"NoLift", CraftFault::kNoLift, "without lift"}),
                         nameOf);

INSTANTIATE_TEST_SUITE_P(, Obedience, testing::Values("OpenLoopPRBS", "ModelPredictive"));

/// The monitor's reason for a craft that plays a PRBS and collides at `at` [s]; `change` is the
/// change of its velocities by the collision.
std::string reasonAfterCollision(double at, const Vector3<double>& change) {
  const Model model = craft();
  const Dynamics<double> dynamics(model);
  ObedienceMonitor monitor(model);
  InputSequence inputs;
  const PrbsSignal signal(makePrbs(9, 1), {});
  Simulation<double> simulation(dynamics, inputs, {}, 0);
  for (int i = 0; i < 2000; ++i) {
    const double now = 0.01 * i;
    const Vector2<double> thrusters = signal.at(now);
    inputs.add(now, thrusters.x(), thrusters.y(), 1);
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

/// A craft with two different thrusters, of which one also pulls, a lag and a delay.
Model unequalCraft() {
  Model model = craft();
  std::vector<Thruster> thrusters = model.thrusters->thrusters();
  thrusters[0].gain = 1.5;
  thrusters[0].least = -0.5;
  thrusters[1].position.y() *= 0.7;
  model.thrusters = std::make_shared<const ThrusterLayout>(thrusters);
  model.body.input_max = 1.3;
  for (const char* effect : {"motor_lag", "input_delay", "marker_offset"})
    model.addEffect(makeEffect(effect));
  model.setValue("motor_lag.tau", 0.08);
  model.setValue("input_delay.delay", 0.02);
  model.setValue("marker_offset.dx", 0.03);
  return model;
}

/// The monitor's definition, computed plainly from all commands and states since the start.
class PlainMonitor {
 public:
  explicit PlainMonitor(const Model& model) : model_(model), told_(3) {
    names_ = {"as without thrust", "as with a fifth of the model's thrust",
              "as with five times the model's thrust", "as if left and right were swapped",
              "as if the left thruster were off", "as if the right thruster were off",
              "as if it sat on the floor, without lift"};
    others_.resize(names_.size());
    models_.assign(names_.size(), model);
    models_[1].body.k *= 0.2;
    models_[2].body.k *= 5;
    Model& sitting = models_.back();
    sitting.addEffect(makeEffect("skirt_friction"));
    sitting.setValue("skirt_friction.f0", typical::force(model.body));
    sitting.setValue("skirt_friction.n0", typical::moment(model.body));
    const Body<double>& body = model.body;
    double forward = 0, turns[2] = {0, 0};  // full force, full moments to both sides
    for (int i = 0; i < model.thrusters->size(); ++i) {
      const Thruster& one = (*model.thrusters)[i];
      const double unit = one.gain * body.k * body.input_max;
      forward += unit * one.most;
      for (const double input : {one.least, one.most}) {
        const double moment = unit * input * model.thrusters->lever(i) * body.l;
        turns[moment > 0] += std::abs(moment);
      }
    }
    most_ = {forward / body.m, std::max(turns[0], turns[1]) / body.I_z};
  }

  void command(double time, const Thrusters<double>& given, double lift) {
    lift_ = lift;
    for (std::size_t i = 0; i < told_.size(); ++i)
      told_[i].add(time + 0.1 * static_cast<double>(i), given, lift);
    const Thrusters<double> off = {0.0, 0.0}, swapped = {given(1), given(0)};
    const std::vector<Thrusters<double>> inputs = {
        off, given, given, swapped, {0.0, given(1)}, {given(0), 0.0}, given};
    for (std::size_t i = 0; i < inputs.size(); ++i)
      others_[i].add(time, inputs[i], i + 1 < inputs.size() ? lift : 0);
  }

  void measure(double time, const RigidState<double>& seen, const Vector3<double>& variance) {
    const RigidState<double> state = stateSeenAs(Dynamics<Jet>(model_), {seen.eta, seen.nu});
    if (begun_ && time - begin_ < 0.1) return;
    if (begun_ && time - begin_ <= 0.25 && lift_ >= 0.5) compare(time, state, variance);
    begun_ = true;
    begin_ = time;
    state_ = state;
    variance_ = variance;
  }

  double evidence(double duration) const { return better(duration).maxCoeff(); }

  std::string disobedience(double duration) const {
    for (const double span : {duration, 2 * duration, 4 * duration}) {
      Eigen::Index best = 0;
      const double all = better(span).maxCoeff(&best), late = better(span / 2)(best);
      if (all >= 4 && late >= 0.5 && all - late >= 0.5) return "it moves " + likely(span, best);
    }
    return "";
  }

 private:
  struct Interval {
    double end;
    Eigen::ArrayXd told, others;
  };

  static Vector3<double> overFloor(const RigidState<double>& state) {
    const double c = std::cos(state.eta.z()), s = std::sin(state.eta.z());
    return {c * state.nu.x() - s * state.nu.y(), s * state.nu.x() + c * state.nu.y(),
            state.nu.z()};
  }

  Vector3<double> moved(const Model& model, const InputSequence& inputs, double time) const {
    const Dynamics<double> dynamics(model);
    Simulation<double> simulation(dynamics, inputs, state_, begin_);
    simulation.advance(time);
    return overFloor(simulation.state());
  }

  void compare(double time, const RigidState<double>& state, const Vector3<double>& variance) {
    const Vector3<double> found = overFloor(state), free = moved(models_[0], others_[0], time),
                          drag = free - overFloor(state_), noise = variance + variance_;
    const double dt = time - begin_;
    const double sizes[2] = {drag.head<2>().norm(), std::abs(drag.z())};
    const double noises[2] = {std::max(noise.x(), noise.y()), noise.z()};
    double spread[2];
    for (int i = 0; i < 2; ++i)
      spread[i] = std::pow(0.03 * most_[i], 2) * dt + std::pow(0.05 * most_[i] * dt, 2) +
                  std::pow(0.5 * sizes[i], 2) + noises[i];
    // Student's t with 4 degrees of freedom, of 2 dimensions and of 1.
    const auto likelihood = [&](const Vector3<double>& predicted) {
      const Vector3<double> off = found - predicted;
      return -3 * std::log(1 + off.head<2>().squaredNorm() / spread[0] / 4) -
             2.5 * std::log(1 + off.z() * off.z() / spread[1] / 4);
    };
    Interval interval{time, Eigen::ArrayXd(9), Eigen::ArrayXd(7)};
    for (int delay = 0; delay < 3; ++delay)
      for (int share = 0; share < 3; ++share) {
        const double size[3] = {0.5, 1, 2};
        const Vector3<double> given = moved(model_, told_[static_cast<std::size_t>(delay)], time);
        interval.told(3 * delay + share) = likelihood(free + size[share] * (given - free));
      }
    for (std::size_t i = 0; i < 7; ++i)
      interval.others(static_cast<Eigen::Index>(i)) = likelihood(moved(models_[i], others_[i], time));
    intervals_.push_back(interval);
  }

  /// Evidence for each other hypothesis against the best of the commands.
  Eigen::ArrayXd better(double duration) const {
    Eigen::ArrayXd told = Eigen::ArrayXd::Zero(9), sum = Eigen::ArrayXd::Zero(7);
    for (const Interval& i : intervals_)
      if (i.end > begin_ - duration) told += i.told;
    Eigen::Index best = 0;
    told.maxCoeff(&best);
    for (const Interval& i : intervals_) {
      if (i.end <= begin_ - duration) continue;
      for (int j = 0; j < 7; ++j) {
        const double gain = i.others(j) - i.told(best);
        sum(j) += j > 0 && i.told(best) > -2 ? std::min(gain, 0.0) : gain;
      }
    }
    return sum;
  }

  std::string likely(double duration, Eigen::Index best) const {
    Eigen::ArrayXd sum = Eigen::ArrayXd::Zero(7);
    bool clear = false;
    for (const Interval& i : intervals_) {
      if (i.end <= begin_ - duration || i.told.maxCoeff() >= -2) continue;
      sum += i.others;
      clear = true;
    }
    if (!clear) return names_[static_cast<std::size_t>(best)];
    std::string text;
    for (int i = 0; i < 7; ++i)
      if (sum(i) > sum.maxCoeff() - 4)
        text += (text.empty() ? "" : ", or ") + names_[static_cast<std::size_t>(i)];
    return text;
  }

  Model model_;
  std::vector<InputSequence> told_, others_;
  std::vector<Model> models_;
  std::vector<std::string> names_;
  std::array<double, 2> most_{};  ///< accelerations by full thrust and by the fastest turn
  double lift_ = 0, begin_ = 0;
  bool begun_ = false;
  RigidState<double> state_;
  Vector3<double> variance_;
  std::vector<Interval> intervals_;
};

/// What a craft does with its commands.
struct Behaviour {
  std::string name;
  Vector2<double> own = {1, 1}, crossed = {0, 0};  ///< share of its own command, of the other's
  double lift = 1;
  Vector3<double> push = Vector3<double>::Zero();  ///< unknown accelerations
};

TEST(ObedienceMonitor, AgreesWithAPlainComputationOfTheLikelihoods) {
  const Model model = unequalCraft();
  const std::vector<Behaviour> behaviours = {
      {"obeys", {1, 1}, {0, 0}, 1, {}},
      {"is pushed", {1, 1}, {0, 0}, 1, {0.2, -0.3, 2}},
      {"deaf", {0, 0}, {0, 0}, 1, {0.05, 0, 0.2}},
      {"weak", {0.2, 0.2}, {0, 0}, 1, {}},
      {"strong", {5, 5}, {0, 0}, 1, {}},
      {"swapped", {0, 0}, {1, 1}, 1, {}},
      {"left off", {0, 1}, {0, 0}, 1, {0, 0.05, 0}},
      {"right off", {1, 0}, {0, 0}, 1, {}},
      {"sits", {1, 1}, {0, 0}, 0, {}}};
  std::map<std::string, int> reports;
  for (std::size_t n = 0; n < behaviours.size(); ++n) {
    const Behaviour& how = behaviours[n];
    std::mt19937 random(static_cast<unsigned>(n + 1));
    std::normal_distribution<double> normal;
    std::uniform_real_distribution<double> uniform(-0.2, 1.0);
    Model truth = model;
    truth.addEffect(makeEffect("skirt_friction"));
    truth.setValue("skirt_friction.f0", typical::force(model.body));
    const Dynamics<double> dynamics(truth);
    InputSequence inputs;
    RigidState<double> start;
    start.eta << 1, -1, 2.5;
    Simulation<double> simulation(dynamics, inputs, start, 0);
    ObedienceMonitor monitor(model);
    PlainMonitor plain(model);
    Vector2<double> held(0, 0);
    for (int i = 0; i < 1300; ++i) {
      const double t = 0.0091 * i;
      const bool obeys = t < 3;
      simulation.advance(t);
      if (i % 2 == 0) {
        if (i % 40 == 0) held << 1.3 * uniform(random), 1.3 * std::max(0.0, uniform(random));
        const double lift = t > 6 && t < 6.6 ? 0.49 : t > 7 && t < 8 ? 0.51 : 1;
        Vector2<double> moves = held;
        if (!obeys)
          moves = how.own.cwiseProduct(held) + how.crossed.cwiseProduct(held.reverse());
        inputs.add(t, moves.x(), moves.y(), obeys ? lift : how.lift * lift);
        monitor.command(t, {held.x(), held.y()}, lift);
        plain.command(t, {held.x(), held.y()}, lift);
      }
      if (!obeys) simulation.state().nu += 0.0091 * how.push;
      // Some states are lost, and there is a gap.
      if (i % 7 == 3 || (i > 700 && i < 750) || (i > 400 && i < 425)) continue;
      const Vector3<double> variance =
          Vector3<double>(1e-4, 2e-4, 1e-2) * (1 + 0.5 * std::sin(t));
      const Measurement<double> truly = simulation.measure();
      RigidState<double> seen{truly.eta, truly.nu};
      for (int c = 0; c < 3; ++c) seen.nu(c) += std::sqrt(variance(c)) * normal(random);
      monitor.measure(t, seen, variance);
      plain.measure(t, seen, variance);
      for (const double duration : {0.7, 1.0, 2.5}) {
        const double wanted = plain.evidence(duration);
        ASSERT_NEAR(monitor.evidence(duration), wanted, 1e-6 * (1 + std::abs(wanted)))
            << how.name << ' ' << t << ' ' << duration;
      }
      const std::string reason = monitor.disobedience(1);
      ASSERT_EQ(reason, plain.disobedience(1)) << how.name << ' ' << t;
      if (!reason.empty()) ++reports[how.name];
    }
  }
  EXPECT_EQ(reports.count("obeys"), 0u);
  for (const char* name : {"deaf", "weak", "strong", "swapped", "left off", "right off", "sits"})
    EXPECT_GT(reports[name], 20) << name;
}

TEST(ObedienceMonitor, ForgetsOnlyCommandsThatNoLongerAct) {
  // Commands at 200 Hz, more than it keeps.
  const Model model = unequalCraft();
  const Dynamics<double> dynamics(model);
  InputSequence inputs;
  Simulation<double> simulation(dynamics, inputs, {}, 0);
  ObedienceMonitor monitor(model);
  PlainMonitor plain(model);
  for (int i = 0; i < 9000; ++i) {
    const double t = 0.005 * i, left = i % 300 < 100 ? 0.8 : 0.1, right = i % 500 < 300 ? 0.6 : 0.2;
    simulation.advance(t);
    inputs.add(t, left, right, 1);
    monitor.command(t, {left, 0.5 * right}, 1);
    if (i >= 7800) plain.command(t, {left, 0.5 * right}, 1);
    if (i < 8800) continue;
    const Measurement<double> seen = simulation.measure();
    for (const auto& measure : {0, 1}) {
      if (measure == 0)
        monitor.measure(t, {seen.eta, seen.nu}, {1e-4, 1e-4, 1e-2});
      else
        plain.measure(t, {seen.eta, seen.nu}, {1e-4, 1e-4, 1e-2});
    }
    ASSERT_NEAR(monitor.evidence(1), plain.evidence(1), 1e-6) << t;
  }
}

TEST(ObedienceMonitor, AnEarlierCommandStartsAgain) {
  const Model model = craft();
  for (const int count : {1, 2, 50}) {
    ObedienceMonitor used(model), fresh(model);
    for (int i = 0; i < count; ++i) {
      used.command(10 + 0.02 * i, {1, 1}, 1);
      used.measure(10 + 0.02 * i, {}, Vector3<double>::Constant(1e-4));
    }
    used.command(9.9, {1, 1}, 1);  // the command that starts again is not kept
    for (int i = 0; i < 100; ++i)
      for (ObedienceMonitor* monitor : {&used, &fresh}) {
        monitor->command(5 + 0.02 * i, {1, 0.5}, 1);
        monitor->measure(5 + 0.02 * i, {}, Vector3<double>::Constant(1e-4));
      }
    EXPECT_GT(fresh.evidence(10), 1);
    EXPECT_EQ(used.evidence(10), fresh.evidence(10)) << count;
  }
}

TEST(ObedienceMonitor, WithoutThrustThereIsNoEvidence) {
  ObedienceMonitor monitor(craft());
  for (int i = 0; i < 1000; ++i) {
    monitor.command(0.01 * i, {0, 0}, 1);
    monitor.measure(0.01 * i, {}, Vector3<double>::Constant(1e-4));
  }
  EXPECT_NEAR(monitor.evidence(10), 0, 1e-12);
  EXPECT_EQ(monitor.disobedience(1), "");
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

}  // namespace
}  // namespace ground

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
