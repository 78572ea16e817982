// Changes of a craft in flight: their names, sizes and starts, and silence about everything else.
#include "ground/estimation/change_monitor.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <memory>
#include <random>
#include <string>

#include "ground/model/capability.h"
#include "ground/model/effect_registry.h"
#include "ground/model/model_file.h"
#include "ground/model/simulation.h"

namespace ground {
namespace change_monitor_test {

Model craft() { return loadModel("cfg/hovercraft/tiny_whoover.yaml"); }
Model fourThrusters() { return loadModel("cfg/hovercraft/four_thrusters.yaml"); }

/// A craft that moves as a palm-sized one does, `slower` times as slowly.
Model slowCraft(double slower) {
  Model model = craft();
  model.setValue("k", model.value("k") / (slower * slower));
  for (const char* damping : {"X_u", "Y_v", "N_r"}) model.setValue(damping, model.value(damping) / slower);
  return model;
}

/// A craft under random commands, in steps of a hundredth of its time scale, and the monitor that watches its
/// noisy poses.
class Flight {
 public:
  explicit Flight(const Model& believed, unsigned seed = 1)
      : scale_(timeScale(believed)), monitor_(believed, ObserverParams()), truth_(believed), random_(seed) {
    setTruth(believed);
  }

  void setTruth(const Model& truth) {
    const RigidState<double> state = simulation_ ? simulation_->state() : RigidState<double>();
    simulation_.reset();
    truth_ = truth;
    dynamics_ = std::make_unique<Dynamics<double>>(truth_);
    simulation_ = std::make_unique<Simulation<double>>(*dynamics_, inputs_, state, time_);
  }
  void setParameter(const std::string& effect, const std::string& parameter, double value) {
    Model changed = truth_;
    if (!changed.hasEffect(effect)) changed.addEffect(makeEffect(effect, *changed.thrusters));
    changed.setValue(effect + "." + parameter, value);
    setTruth(changed);
  }
  void scale(const std::string& parameter, double factor) {
    Model changed = truth_;
    changed.setValue(parameter, factor * changed.value(parameter));
    setTruth(changed);
  }
  void hit(const Vector3<double>& change) { simulation_->state().nu += change; }

  /// Flies for a duration; returns when the monitor first named something, since now, or infinity. Both in
  /// time scales.
  double fly(double duration, double lift = 1, double thrust = 1) {
    const double began = time_;
    double said = std::numeric_limits<double>::infinity();
    std::normal_distribution<double> normal;
    std::uniform_real_distribution<double> level(0.05 * thrust, 0.9 * thrust);
    const ThrusterLayout& layout = *truth_.thrusters;
    for (int i = 0; i < std::lround(100 * duration); ++i) {
      if (i % 25 == 0)
        for (int j = 0; j < held_.size(); ++j) held_(j) = lift > 0 ? layout[j].most * level(random_) : 0;
      monitor_.command(time_, held_, lift);
      inputs_.add(time_, held_, lift);
      time_ += 0.01 * scale_;
      simulation_->advance(time_);
      RigidState<double> seen = simulation_->state();
      for (int axis = 0; axis < 3; ++axis) seen.eta(axis) += (axis < 2 ? 4e-4 : 5e-3) * normal(random_);
      monitor_.measure(time_, seen);
      if (std::isinf(said) && !monitor_.report().changes.empty()) said = (time_ - began) / scale_;
    }
    return said;
  }

  const ChangeMonitor::Report& report() const { return monitor_.report(); }
  ChangeMonitor& monitor() { return monitor_; }
  double time() const { return time_; }

 private:
  double scale_;  ///< [s]
  ChangeMonitor monitor_;
  Model truth_;
  std::mt19937 random_;
  Thrusters<double> held_ = Thrusters<double>::zero(truth_.thrusters->size());
  InputSequence inputs_{held_.size()};
  double time_ = 0;
  std::unique_ptr<Dynamics<double>> dynamics_;
  std::unique_ptr<Simulation<double>> simulation_;
};

void expectChange(const ChangeMonitor::Report& report, const std::string& what, double size, double since) {
  ASSERT_EQ(report.changes.size(), 1u) << report.text();
  const ChangeMonitor::Change& change = report.changes.front();
  EXPECT_EQ(change.what, what) << report.text();
  EXPECT_LT(change.lower, size) << report.text();
  EXPECT_GT(change.upper, size) << report.text();
  EXPECT_LT(change.upper - change.lower, 1.5 * std::abs(size)) << report.text();
  EXPECT_NEAR(change.since, since, 0.5) << report.text();
}

TEST(ChangeMonitor, NamesAWeakThruster) {
  for (const double side : {1.0, -1.0}) {
    Flight flight(craft());
    EXPECT_TRUE(std::isinf(flight.fly(8)));
    const double since = flight.time();
    flight.scale("k", 0.9);  // with the asymmetry: one thruster at 0.8, the other as before
    flight.setParameter("thrust_asymmetry", "a", -side / 9);
    EXPECT_LT(flight.fly(3), 3);
    flight.fly(4);
    expectChange(flight.report(), side > 0 ? "left thruster" : "right thruster", -0.2, since);
    EXPECT_NEAR(flight.report().asymmetry, -side * 0.1, 5 * flight.report().asymmetry_deviation);
  }
}

TEST(ChangeMonitor, NamesAChangeOfASlowCraftInItsOwnTime) {
  const Model model = slowCraft(20);
  ASSERT_EQ(timeScale(model), 20);
  Flight flight(model);
  EXPECT_TRUE(std::isinf(flight.fly(8))) << flight.report().text();
  flight.setParameter("thrust_asymmetry", "a", -0.15);
  flight.scale("k", 0.85);
  EXPECT_LT(flight.fly(3), 3);
  flight.fly(4);
  ASSERT_EQ(flight.report().changes.size(), 1u) << flight.report().text();
  EXPECT_EQ(flight.report().changes.front().what, "left thruster") << flight.report().text();
}

struct Wrong {
  const char *effect, *parameter;
  double value;
};

// A model that was wrong from the start: the craft has not changed.
TEST(ChangeMonitor, DoubtsAModelThatHasNeverHeld) {
  for (const Wrong& wrong : {Wrong{"motor_lag", "tau", 0.1}, Wrong{"momentum_drag", "q", 0.05},
                             Wrong{"thrust_curve", "p", 2}, Wrong{"differential_side_force", "c", 0.66}}) {
    for (const unsigned seed : {1u, 2u, 3u}) {
      Flight flight(craft(), seed);
      flight.setParameter(wrong.effect, wrong.parameter, wrong.value);
      EXPECT_TRUE(std::isinf(flight.fly(15))) << wrong.effect << ": " << flight.report().text();
      EXPECT_EQ(flight.report().doubt,
                "the model has not predicted the motion since the drive began: diagnose it")
          << wrong.effect;
      EXPECT_TRUE(flight.report().change.isZero());
    }
  }
}

TEST(ChangeMonitor, HasNoDoubtAboutARightModel) {
  for (const unsigned seed : {1u, 2u, 3u}) {
    Flight flight(craft(), seed);
    flight.fly(20);
    EXPECT_EQ(flight.report().doubt, "");
  }
}

// A weak thruster shows when the craft is driven; it may have been weak before.
TEST(ChangeMonitor, NamesNoChangeThatMayHaveBeenThereBefore) {
  Flight flight(craft());
  flight.scale("k", 0.85);
  flight.setParameter("thrust_asymmetry", "a", 0.18);
  flight.fly(10, 1, 0);
  EXPECT_TRUE(std::isinf(flight.fly(10))) << flight.report().text();
}

TEST(ChangeMonitor, NamesNoSizeThatPhysicsExcludes) {
  for (const Wrong& wrong : {Wrong{"motor_lag", "tau", 0.1}, Wrong{"differential_side_force", "c", 0.66},
                             Wrong{"thrust_misalignment", "angle", 0.4}, Wrong{"momentum_drag", "q", 0.05}}) {
    Flight flight(craft());
    flight.fly(8);
    flight.setParameter(wrong.effect, wrong.parameter, wrong.value);
    for (int i = 0; i < 80; ++i) {
      flight.fly(0.1);
      for (const ChangeMonitor::Change& change : flight.report().changes) {
        EXPECT_GE(change.lower, -1) << wrong.effect << ": " << flight.report().text();
        EXPECT_LE(change.lower, change.size);
        EXPECT_LE(change.size, change.upper);
        EXPECT_LE(change.upper, change.what == "drag" ? 5 : 1) << flight.report().text();
      }
    }
    EXPECT_LE(flight.report().changes.size(), 1u) << wrong.effect << ": " << flight.report().text();
  }
}

TEST(ModelTrust, BelievesWhatBeganAfterAHold) {
  ModelTrust trust(2);
  trust.observe(10);
  EXPECT_FALSE(trust.holdsBefore(17));
  EXPECT_TRUE(trust.holdsBefore(18.1));
  trust.observe(19);
  EXPECT_TRUE(trust.hasHeld());
  trust.named(20);
  EXPECT_FALSE(trust.holdsBefore(35)) << "the changed model has to hold for longer";
  EXPECT_TRUE(trust.holdsBefore(36.1));
  EXPECT_FALSE(trust.doubtSince());
}

TEST(ModelTrust, DoubtsAfterTwoFailuresUntilTheModelHolds) {
  ModelTrust trust(1);
  trust.observe(3);
  trust.fail(4);
  EXPECT_FALSE(trust.doubtSince()) << "once may be a collision";
  trust.hit(6);
  ASSERT_TRUE(trust.doubtSince());
  EXPECT_EQ(*trust.doubtSince(), 3) << "it never held";
  for (double time = 6; time < 23; time += 0.1) trust.observe(time);
  EXPECT_FALSE(trust.doubtSince());
  trust.hit(24);
  trust.hit(25);
  EXPECT_FALSE(trust.doubtSince()) << "collisions of a craft whose model has held";
  trust.fail(26);
  trust.fail(27);
  EXPECT_EQ(trust.doubtSince().value_or(0), 26);
  trust.reset();
  EXPECT_FALSE(trust.doubtSince() || trust.hasHeld());
}

TEST(ChangeMonitor, NamesEachOfFourThrusters) {
  const Model model = fourThrusters();
  for (int i = 0; i < 4; ++i) {
    const std::string name = (*model.thrusters)[i].name;
    Flight flight(model);
    flight.fly(8);
    const double since = flight.time();
    flight.setParameter("thruster_gain_" + name, "a", -0.4);
    EXPECT_LT(flight.fly(3), 3) << name;
    flight.fly(5);
    expectChange(flight.report(), name + " thruster", -0.4, since);
  }
}

TEST(ChangeMonitor, NamesADeadJetOfACraftWithLittleThrust) {
  const Model model = loadModel("cfg/craft/air_table.yaml");
  for (const int i : {0, 5}) {
    const std::string name = (*model.thrusters)[i].name;
    Flight flight(model);
    EXPECT_TRUE(std::isinf(flight.fly(8))) << flight.report().text();
    flight.setParameter("thruster_gain_" + name, "a", -1);
    EXPECT_LT(flight.fly(3), 3) << name;
    flight.fly(5);
    const CraftChange& craft = flight.monitor().craft();
    EXPECT_EQ(craft.deadNames(flight.report().change), name) << flight.report().text();
  }
}

TEST(CraftChange, KnowsDeadThrustersOfMoreThanTwo) {
  const CraftChange four(fourThrusters()), two(craft());
  Eigen::VectorXd change = Eigen::VectorXd::Zero(four.size());
  change(1) = -0.97;
  change(3) = -0.5;
  EXPECT_EQ(four.dead(change), std::vector<int>{1});
  EXPECT_EQ(four.deadNames(change), "back_right");
  EXPECT_EQ(four.deadOnly(change)(3), 0);
  EXPECT_LT(four.deadOnly(change)(1), -0.9);
  change.head(3).setConstant(-0.97);
  EXPECT_TRUE(four.dead(change).empty()) << "too few are left";
  EXPECT_TRUE(two.dead(Eigen::VectorXd::Constant(two.size(), -0.97)).empty());
}

TEST(ChangeMonitor, NamesALoad) {
  Flight flight(craft());
  flight.fly(8);
  const double since = flight.time();
  flight.scale("m", 1.15);
  flight.scale("I_z", 1.09);
  flight.setParameter("com_offset", "xg", 0.004);
  EXPECT_LT(flight.fly(3), 3);
  flight.fly(6);
  expectChange(flight.report(), "mass", 0.15, since);
  const int centre = flight.monitor().craft().centre();
  EXPECT_NEAR(flight.report().change(centre), 0.004, 0.002);
}

TEST(ChangeMonitor, NamesDrag) {
  Flight flight(craft());
  flight.fly(8);
  const double since = flight.time();
  for (const char* damping : {"X_u", "Y_v", "N_r"}) flight.scale(damping, 2);
  EXPECT_LT(flight.fly(3), 3);
  flight.fly(6);
  expectChange(flight.report(), "drag", 1, since);
}

TEST(ChangeMonitor, IsSilentAboutBatteryFloorAndTrim) {
  Flight flight(craft());
  flight.setParameter("battery_sag", "tau", 200);
  flight.setParameter("floor_tilt", "sx", 2e-3);
  flight.setParameter("body_force_bias", "y0", 1e-3);
  flight.setParameter("thrust_asymmetry", "a", 0.02);
  EXPECT_TRUE(std::isinf(flight.fly(60))) << flight.report().text();
  EXPECT_LT(flight.report().estimate(0), -0.15) << "the sag is followed";
}

TEST(ChangeMonitor, TakesAVoltageForNoChange) {
  Model model = craft();
  model.addEffect(makeEffect("battery_voltage"));
  model.setValue("battery_voltage.p", 2);
  model.body.volts = 7.4;
  for (const bool told : {true, false}) {
    Flight flight(model);
    flight.scale("k", std::pow(6.7 / 7.4, 2));
    if (told) flight.monitor().voltage(6.7);
    flight.fly(20);
    for (int thruster = 0; thruster < 2; ++thruster)
      EXPECT_NEAR(flight.report().estimate(thruster), told ? 0 : std::pow(6.7 / 7.4, 2) - 1, 0.06) << told;
  }
}

TEST(ChangeMonitor, IsSilentAboutACollision) {
  Flight flight(craft());
  flight.fly(8);
  flight.hit({0.4, -0.5, 6});
  EXPECT_TRUE(std::isinf(flight.fly(8))) << flight.report().text();
}

TEST(ChangeMonitor, ANewDriveAndAnEarlierTimeForget) {
  for (const bool new_drive : {true, false}) {
    Flight flight(craft());
    flight.fly(6);
    for (const char* damping : {"X_u", "Y_v", "N_r"}) flight.scale(damping, 2.5);
    flight.fly(3);
    ASSERT_FALSE(flight.report().changes.empty());
    if (new_drive) {
      flight.fly(DriveClock::kPause + 0.5, 0);
      EXPECT_FALSE(flight.report().changes.empty()) << "the change stays while the craft rests";
      flight.fly(0.1);
    } else {
      flight.monitor().command(1, {0, 0}, 1);
    }
    EXPECT_TRUE(flight.report().changes.empty());
    EXPECT_TRUE(flight.report().change.isZero());
  }
}

TEST(CraftChange, TakesOnlyWhatIsInBounds) {
  for (const Model& model : {craft(), fourThrusters()}) {
    const CraftChange change(model);
    const Eigen::VectorXd none = Eigen::VectorXd::Zero(change.size());
    const Model same = change.apply(none);
    for (const ParameterInfo& parameter : model.parameters())
      EXPECT_DOUBLE_EQ(same.value(parameter.name), model.value(parameter.name)) << parameter.name;
    const double nan = std::numeric_limits<double>::quiet_NaN(),
                 infinity = std::numeric_limits<double>::infinity();
    for (const double value : {nan, infinity, -infinity, 1e9, -1e9}) {
      const Model changed = change.apply(Eigen::VectorXd::Constant(change.size(), value));
      EXPECT_NO_THROW(Dynamics<double>{changed});
      EXPECT_GT(changed.body.m, 0.4 * model.body.m);
      EXPECT_LT(changed.body.m, 2.1 * model.body.m);
    }
    EXPECT_THROW(change.apply(Eigen::VectorXd::Zero(1)), std::invalid_argument);
  }
}

TEST(CraftChange, WeakensOneThruster) {
  for (const Model& model : {craft(), fourThrusters()}) {
    const CraftChange change(model);
    for (int i = 0; i < change.thrusters(); ++i) {
      Eigen::VectorXd weaker = Eigen::VectorXd::Zero(change.size());
      weaker(i) = -0.3;
      const Dynamics<double> before(model), after(change.apply(weaker));
      for (int j = 0; j < change.thrusters(); ++j) {
        Thrusters<double> input = Thrusters<double>::zero(change.thrusters());
        input(j) = 0.5;
        const Vector3<double> was = before.derivative(0, {}, input, {1, std::nullopt}).nu,
                              is = after.derivative(0, {}, input, {1, std::nullopt}).nu;
        EXPECT_TRUE(is.isApprox((i == j ? 0.7 : 1) * was, 1e-9)) << i << ' ' << j;
      }
    }
  }
}

}  // namespace change_monitor_test
}  // namespace ground
