// A model that stops predicting: since when and in which channels, and silence while it holds.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <memory>
#include <random>
#include <string>

#include "../crafts.h"
#include "ground/estimation/model_monitor.h"
#include "ground/model/capability.h"
#include "ground/model/simulation.h"

namespace ground {
namespace model_failure_test {

constexpr double kNever = std::numeric_limits<double>::infinity();

Model craft() { return tinyWhoover(); }

/// A craft that moves as a palm-sized one does, `slower` times as slowly.
Model slowCraft(double slower) {
  Model model = craft();
  model.setValue("k", model.value("k") / (slower * slower));
  for (const char* damping : {"X_u", "Y_v", "N_r"}) model.setValue(damping, model.value(damping) / slower);
  return model;
}

MonitorParams params(const Model& model) {
  MonitorParams p;
  p.horizon *= timeScale(model);
  p.window *= timeScale(model);
  p.observer.push = 0.02;  // as live_comparison has them
  p.observer.twist = 0.5;
  p.observer.push_drift = 0.5;
  p.observer.twist_drift = 10;
  return p;
}

/// A craft under random commands and pushes, in steps of a hundredth of its time scale, and the monitor that
/// watches its noisy poses.
class Flight {
 public:
  explicit Flight(const Model& believed, unsigned seed = 1)
      : scale_(timeScale(believed)), monitor_(believed, params(believed)), truth_(believed), random_(seed) {
    const Vector2<double> most = capability(believed).accelerations(believed.body.m, believed.body.I_z);
    pushes_ = 0.02 * Vector3<double>(most.x(), most.x(), most.y());
    setTruth(believed);
  }

  void setTruth(const Model& truth) {
    const RigidState<double> state = simulation_ ? simulation_->state() : RigidState<double>();
    simulation_.reset();
    truth_ = truth;
    dynamics_ = std::make_unique<Dynamics<double>>(truth_);
    simulation_ = std::make_unique<Simulation<double>>(*dynamics_, inputs_, state, time_);
  }
  void setParameter(const std::string& parameter, double value) {
    setTruth(withValues(truth_, {{parameter, value}}));
  }
  void scale(const std::string& parameter, double factor) {
    setParameter(parameter, factor * truth_.value(parameter));
  }
  /// The left thruster has a share of its force.
  void weaken(double share) {
    scale("k", 0.5 * (1 + share));
    setParameter("thrust_asymmetry.a", (share - 1) / (share + 1));
  }
  void hit(const Vector3<double>& change) { simulation_->state().nu += change; }

  /// Flies for a duration; returns when a channel first failed, since now, or infinity. Both in time scales.
  double fly(double duration, double lift = 1, double thrust = 1) {
    const double began = time_;
    double failed = kNever;
    std::normal_distribution<double> normal;
    std::uniform_real_distribution<double> level(0.05 * thrust, 0.9 * thrust);
    const ThrusterLayout& layout = *truth_.thrusters;
    for (int i = 0; i < std::lround(100 * duration); ++i) {
      if (i % 25 == 0)
        for (int j = 0; j < held_.size(); ++j) held_(j) = lift > 0 ? layout[j].most * level(random_) : 0;
      monitor_.command(time_, held_, lift);
      inputs_.add(time_, held_, lift);
      time_ += 0.01 * scale_;
      for (int axis = 0; axis < 3; ++axis) {  // correlated over half a time scale
        push_(axis) = 0.98 * push_(axis) + std::sqrt(1 - 0.98 * 0.98) * pushes_(axis) * normal(random_);
        simulation_->state().nu(axis) += 0.01 * scale_ * (lift > 0 ? push_(axis) : 0);
      }
      simulation_->advance(time_);
      RigidState<double> seen = simulation_->state();
      for (int axis = 0; axis < 3; ++axis) seen.eta(axis) += (axis < 2 ? 4e-4 : 5e-3) * normal(random_);
      if (const auto found = monitor_.measure(time_, seen, poseMeasurement(seen.eta, 4e-4, 5e-3)))
        since_ = found->failing_since;
      if (std::isinf(failed) && fails()) failed = (time_ - began) / scale_;
    }
    return failed;
  }

  bool fails() const { return !failureText(since_).empty(); }
  const Vector3<double>& since() const { return since_; }
  ModelMonitor& monitor() { return monitor_; }
  double time() const { return time_; }

 private:
  double scale_;  ///< [s]
  ModelMonitor monitor_;
  Model truth_;
  std::mt19937 random_;
  Vector3<double> pushes_, push_ = Vector3<double>::Zero();  ///< level and present value
  Vector3<double> since_ = Vector3<double>::Constant(std::numeric_limits<double>::quiet_NaN());
  Thrusters<double> held_ = Thrusters<double>::zero(truth_.thrusters->size());
  InputSequence inputs_{held_.size()};
  double time_ = 0;
  std::unique_ptr<Dynamics<double>> dynamics_;
  std::unique_ptr<Simulation<double>> simulation_;
};

TEST(ModelFailure, HalfAThrusterShowsInYawSinceItWasLost) {
  for (const unsigned seed : {1u, 2u, 3u}) {
    for (const double slower : {1.0, 20.0}) {
      const Model model = slowCraft(slower);
      Flight flight(model, seed);
      EXPECT_EQ(flight.fly(10), kNever);
      const double lost = flight.time();
      flight.weaken(0.5);
      EXPECT_LT(flight.fly(4), 2);
      EXPECT_NEAR(flight.since()(2), lost, 0.5 * timeScale(model)) << failureText(flight.since());
      EXPECT_TRUE(std::isnan(flight.since()(1))) << failureText(flight.since());
    }
  }
}

TEST(ModelFailure, ASlopeShowsInSurgeAndSwayAndNotInYaw) {
  Flight flight(craft());
  flight.fly(10);
  flight.setParameter("floor_tilt.sx", 0.05);
  EXPECT_LT(flight.fly(10), 3);
  EXPECT_TRUE(std::isfinite(flight.since()(0)) && std::isfinite(flight.since()(1)));
  EXPECT_TRUE(std::isnan(flight.since()(2))) << failureText(flight.since());
}

TEST(ModelFailure, ATrimAndABatteryAndAFloorOfUsualSizeAreNoFailureInAQuarterOfAnHour) {
  for (const unsigned seed : {1u, 2u, 3u}) {
    Flight flight(craft(), seed);
    flight.setParameter("floor_tilt.sx", 2e-3);
    flight.setParameter("body_force_bias.y0", 2e-3);
    flight.setParameter("thrust_asymmetry.a", 0.02);
    flight.setParameter("battery_sag.tau", 6000);
    flight.scale("k", 1.02);
    EXPECT_EQ(flight.fly(300, 1, seed == 1 ? 0.3 : 1), kNever) << failureText(flight.since());
  }
}

TEST(ModelFailure, ACollisionIsNone) {
  for (const unsigned seed : {1u, 2u, 3u}) {
    Flight flight(craft(), seed);
    flight.fly(8);
    flight.hit({0.4, -0.5, 6});
    EXPECT_EQ(flight.fly(8), kNever) << failureText(flight.since());
  }
}

TEST(ModelFailure, AModelWithAKnownDisturbanceFailsBySizesOfItsOwn) {
  Model quiet = craft(), rough = craft();
  quiet.disturbance.sigma << 5e-4, 5e-4, 1e-5;
  rough.disturbance.sigma << 0.02, 0.02, 1e-3;
  quiet.disturbance.time.setConstant(0.5);
  rough.disturbance.time.setConstant(0.5);
  const auto fails = [](const Model& model, double k) {
    FailureWatch watch(model);
    for (double time = 0; time < 5; time += 0.01) watch.add(time, {k, 0, 0}, {1e-4, 1e-4, 1e-2}, true);
    return std::isfinite(watch.since()(0));
  };
  EXPECT_TRUE(fails(quiet, 0.1));
  EXPECT_FALSE(fails(craft(), 0.1));
  EXPECT_TRUE(fails(craft(), 0.5));
  EXPECT_FALSE(fails(rough, 0.5));
}

TEST(ModelFailure, StaysWhileTheCraftRestsAndEndsWhenTheModelHoldsAgain) {
  FailureWatch watch(craft());
  double time = 0;
  const auto pass = [&](double duration, double missing, bool moves) {
    for (const double end = time + duration; time < end; time += 0.01)
      watch.add(time, {0, 0, missing}, {1e-4, 1e-4, 1e-2}, moves);
    return failureText(watch.since());
  };
  EXPECT_EQ(pass(10, 0, true), "");
  EXPECT_EQ(pass(3, 50, true), "yaw since 10.0 s");
  EXPECT_EQ(pass(60, 0, false), "yaw since 10.0 s");
  EXPECT_EQ(pass(4, 0, true), "");
  EXPECT_NE(pass(60, -50, true), "");
  EXPECT_NE(pass(8, 0, true), "");
  EXPECT_EQ(pass(5, 0, true), "");
}

TEST(ModelFailure, ANewDriveAndAnEarlierTimeForget) {
  for (const bool new_drive : {true, false}) {
    Flight flight(craft());
    flight.fly(6);
    flight.weaken(0.3);
    flight.fly(4);
    ASSERT_TRUE(flight.fails());
    if (new_drive) {
      flight.fly(DriveClock::kPause + 0.5, 0);
      EXPECT_TRUE(flight.fails()) << "the failure stays while the craft rests";
      flight.fly(0.1);
    } else {
      flight.monitor().reset();
      flight.fly(1.1);
    }
    EXPECT_FALSE(flight.fails()) << failureText(flight.since());
  }
}

TEST(ModelFailure, IsToldInTheOrderOfTime) {
  const double no = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(failureText({13.04, no, 12.4}), "yaw since 12.4 s, surge since 13.0 s");
  EXPECT_EQ(failureText({no, 1, no}), "sway since 1.0 s");
  EXPECT_EQ(failureText({no, no, no}), "");
}

}  // namespace model_failure_test
}  // namespace ground
