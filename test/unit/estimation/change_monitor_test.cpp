// Changes of a craft in flight: their names, sizes and starts, and silence about everything else.
#include "ground/estimation/change_monitor.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <memory>
#include <random>
#include <string>

#include "ground/model/effect_registry.h"
#include "ground/model/model_file.h"
#include "ground/model/simulation.h"

namespace ground {
namespace change_monitor_test {

Model craft() { return loadModel("cfg/hovercraft/tiny_whoover.yaml"); }
Model fourThrusters() { return loadModel("cfg/hovercraft/four_thrusters.yaml"); }

/// A craft under random commands, in steps of 10 ms, and the monitor that watches its noisy poses.
class Flight {
 public:
  explicit Flight(const Model& believed, unsigned seed = 1)
      : monitor_(believed, ObserverParams()), truth_(believed), random_(seed) {
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

  /// Flies for `duration` [s]; returns when the monitor first said something [s since now], or infinity.
  double fly(double duration, double lift = 1) {
    const double began = time_;
    double said = std::numeric_limits<double>::infinity();
    std::normal_distribution<double> normal;
    std::uniform_real_distribution<double> level(0.05, 0.9);
    const ThrusterLayout& layout = *truth_.thrusters;
    for (int i = 0; i < std::lround(100 * duration); ++i) {
      if (i % 25 == 0)
        for (int j = 0; j < held_.size(); ++j) held_(j) = lift > 0 ? layout[j].most * level(random_) : 0;
      monitor_.command(time_, held_, lift);
      inputs_.add(time_, held_, lift);
      time_ += 0.01;
      simulation_->advance(time_);
      RigidState<double> seen = simulation_->state();
      for (int axis = 0; axis < 3; ++axis) seen.eta(axis) += (axis < 2 ? 4e-4 : 5e-3) * normal(random_);
      monitor_.measure(time_, seen);
      if (std::isinf(said) && !monitor_.report().changes.empty()) said = time_ - began;
    }
    return said;
  }

  const ChangeMonitor::Report& report() const { return monitor_.report(); }
  ChangeMonitor& monitor() { return monitor_; }
  double time() const { return time_; }

 private:
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
    flight.fly(3);
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
        const Vector3<double> was = before.derivative(0, {}, input, 1).nu,
                              is = after.derivative(0, {}, input, 1).nu;
        EXPECT_TRUE(is.isApprox((i == j ? 0.7 : 1) * was, 1e-9)) << i << ' ' << j;
      }
    }
  }
}

}  // namespace change_monitor_test
}  // namespace ground
