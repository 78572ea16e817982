// Models compared with a running experiment.
#include "ground/estimation/model_monitor.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

#include "../crafts.h"
#include "ground/control/prbs.h"
#include "ground/estimation/floor_map.h"

namespace ground {
namespace model_monitor_test {

constexpr double kPosition = 3e-4, kHeading = 5e-3;  // noise of poses [m], [rad]

PoseMeasurement pose(const RigidState<double>& state) {
  return poseMeasurement(state.eta, kPosition, kHeading);
}

Model craft() { return tinyWhoover(); }
Model with(const std::vector<std::pair<std::string, double>>& values) { return withValues(craft(), values); }

/// Simulates a PRBS run of a true model at 100 Hz. Monitors get its commands, `each` its noisy
/// states.
class Experiment {
 public:
  /// rows: inputs of left and right, 15 a second, again and again; a PRBS if there are none.
  explicit Experiment(const Model& truth, std::vector<std::array<double, 2>> rows = {})
      : dynamics_(truth), rows_(std::move(rows)) {
    if (rows_.empty())
      for (const auto& [left, right] : makePrbs(9, 1)) rows_.push_back({double(left), double(right)});
  }

  template <class Each>
  void run(double from, double until, std::vector<ModelMonitor*> monitors, Each each) {
    InputSequence inputs;
    for (double t = 0; t < until; t += 1 / 15.0) {
      const auto& row = rows_[static_cast<std::size_t>(t * 15.0 + 0.5) % rows_.size()];
      inputs.add(t, row[0], row[1], 1);
    }
    Simulation<double> simulation(dynamics_, inputs, {}, 0);
    std::size_t next = 0;
    for (int i = 0; i * 0.01 < until; ++i) {
      const double t = i * 0.01;
      simulation.advance(t);
      for (; next < inputs.size() && inputs.times[next] <= t; ++next)
        for (ModelMonitor* m : monitors) m->command(from + inputs.times[next], inputs.thrusters[next], 1);
      const Measurement<double> seen = simulation.measure();
      RigidState<double> state{seen.eta, seen.nu};
      for (int c = 0; c < 3; ++c) {
        state.eta(c) += (c < 2 ? kPosition : kHeading) * normal_(random_);
        state.nu(c) += (c < 2 ? 5e-3 : 5e-2) * normal_(random_);
      }
      each(from + t, state);
    }
  }

 private:
  Dynamics<double> dynamics_;
  std::vector<std::array<double, 2>> rows_;
  std::mt19937 random_{1};
  std::normal_distribution<double> normal_;
};

/// Whether a root mean square of few independent predictions is what the noise leaves.
void expectNoise(const PoseError& rms, const PoseError& noise) {
  for (const auto& [found, expected] :
       {std::pair(rms.position, noise.position), {rms.heading, noise.heading}}) {
    EXPECT_GT(found, 0.6 * expected);
    EXPECT_LT(found, 1.6 * expected);
  }
}

TEST(ModelMonitor, ATrueModelShowsWhatTheNoiseLeaves) {
  for (const Model& truth : {craft(), with({{"motor_lag.tau", 0.06}}), with({{"input_delay.delay", 0.05}}),
                             with({{"heading_offset.psi0", 1.2}}),
                             with({{"marker_offset.dx", 0.03}, {"marker_offset.dy", 0.01}})}) {
    ModelMonitor monitor(truth, {});
    std::optional<ModelMonitor::Error> last;
    double first = -1;
    Experiment(truth).run(0, 15, {&monitor}, [&](double t, const RigidState<double>& s) {
      const auto found = monitor.measure(t, s, pose(s));
      if (found && first < 0) first = t;
      if (found) last = found;
    });
    ASSERT_TRUE(last);
    EXPECT_NEAR(first, 1.0, 0.011);
    EXPECT_NEAR(last->horizon, 1.0, 0.011);
    EXPECT_NEAR(last->covered, 10.0, 0.011);
    EXPECT_TRUE(last->excited);
    expectNoise(last->rms, last->noise);
    EXPECT_LT(last->noise.position, 0.02);
    EXPECT_LT(last->noise.heading, 0.1);
  }
}

TEST(ModelMonitor, KnowsTheThrustByTheVoltage) {
  Model model = with({{"battery_voltage.p", 2}}), weak = craft();
  model.body.volts = 7.4;
  weak.setValue("k", weak.value("k") * std::pow(6.7 / 7.4, 2));
  ModelMonitor told(model, {}), untold(model, {});
  std::optional<ModelMonitor::Error> by_voltage, without;
  Experiment(weak).run(0, 15, {&told, &untold}, [&](double t, const RigidState<double>& s) {
    told.voltage(t, 6.7);
    if (const auto found = told.measure(t, s, pose(s))) by_voltage = found;
    if (const auto found = untold.measure(t, s, pose(s))) without = found;
  });
  ASSERT_TRUE(by_voltage && without);
  expectNoise(by_voltage->rms, by_voltage->noise);
  EXPECT_GT(without->rms.position, 2 * without->noise.position);
}

/// The error at the end of 40 s of constant inputs, by which a craft comes to a steady circle.
std::optional<ModelMonitor::Error> onACircle(const Model& truth, const Model& model) {
  ModelMonitor monitor(model, {});
  std::optional<ModelMonitor::Error> last;
  Experiment(truth, {{0.2, 0.22}}).run(0, 40, {&monitor}, [&](double t, const RigidState<double>& s) {
    if (const auto found = monitor.measure(t, s, pose(s))) last = found;
  });
  return last;
}

TEST(ModelMonitor, ARightModelOnASteadyCircleShowsItsNoiseAndAWrongOneHowWrongItIs) {
  const auto right = onACircle(craft(), craft());
  ASSERT_TRUE(right);
  EXPECT_TRUE(right->excited);
  expectNoise(right->rms, right->noise);
  // 0.02 N on 0.0583 kg is 170 mm after 1 s.
  const auto wrong = onACircle(with({{"body_force_bias.x0", 0.02}, {"body_force_bias.y0", 0}}), craft());
  ASSERT_TRUE(wrong);
  EXPECT_GT(wrong->rms.position, 0.08);
  EXPECT_LT(wrong->rms.position, 0.25);
}

TEST(ModelMonitor, ACraftAtRestTellsNothing) {
  ModelMonitor monitor(craft(), {});
  std::mt19937 random{1};
  std::normal_distribution<double> normal;
  std::optional<ModelMonitor::Error> last;
  monitor.command(0, {0, 0}, 1);
  for (int i = 0; i < 1000; ++i) {
    const double x = 3e-4 * normal(random), y = 3e-4 * normal(random), psi = 5e-3 * normal(random);
    if (const auto found = monitor.measure(0.01 * i, {}, pose({{x, y, psi}, {0, 0, 0}}))) last = found;
  }
  ASSERT_TRUE(last);
  EXPECT_FALSE(last->excited);
  expectNoise(last->rms, last->noise);
}

TEST(ModelMonitor, OnTheFloorNothingIsPooled) {
  ModelMonitor monitor(craft(), {});
  std::optional<ModelMonitor::Error> flying, landed;
  Experiment(craft()).run(0, 5, {&monitor}, [&](double t, const RigidState<double>& s) {
    if (const auto found = monitor.measure(t, s, pose(s))) flying = found;
  });
  monitor.command(5, {0, 0}, 0);
  for (int i = 0; i < 200; ++i) landed = monitor.measure(5 + 0.01 * i, {}, pose({}));
  ASSERT_TRUE(flying && landed);
  EXPECT_TRUE(flying->excited);
  EXPECT_FALSE(landed->excited);
  EXPECT_NEAR(landed->rms.position, flying->rms.position, 0.1 * flying->rms.position);
}

TEST(ModelMonitor, TheMissingWrenchIsThatOfTheHiddenEffect) {
  const Model truth = with({{"body_force_bias.x0", 0.02}, {"body_force_bias.y0", -0.01}});
  ModelMonitor nominal(craft(), {}), right(truth, {});
  Vector3<double> missing = Vector3<double>::Zero(), rest = missing, off = missing;
  int count = 0;
  double errors[2] = {0, 0};
  Experiment(truth).run(0, 15, {&nominal, &right}, [&](double t, const RigidState<double>& s) {
    const auto a = nominal.measure(t, s, pose(s)), b = right.measure(t, s, pose(s));
    if (!a || !b || t < 3) return;
    missing += a->wrench;
    rest += b->wrench;
    off += b->wrench.cwiseQuotient(b->wrench_noise).cwiseAbs2();
    ++count;
    errors[0] = a->rms.position;
    errors[1] = b->rms.position;
  });
  EXPECT_NEAR(missing.x() / count, 0.02, 0.002);
  EXPECT_NEAR(missing.y() / count, -0.01, 0.002);
  EXPECT_NEAR(missing.z() / count, 0, 2e-4);
  EXPECT_NEAR(rest.x() / count, 0, 1e-3);
  EXPECT_NEAR(rest.y() / count, 0, 1e-3);
  EXPECT_GT(errors[0], 2 * errors[1]);
  for (int i = 0; i < 3; ++i) EXPECT_NEAR(off(i) / count, 1, 0.4) << "what the noise of the poses explains";
}

TEST(ModelMonitor, ResetsWhenTimeJumpsBack) {
  ModelMonitor monitor(craft(), {});
  int found = 0;
  const auto count = [&](double t, const RigidState<double>& s) {
    found += monitor.measure(t, s, pose(s)).has_value();
  };
  Experiment(craft()).run(100, 3, {&monitor}, count);
  const int before = found;
  EXPECT_NEAR(before, 200, 2);
  Experiment(craft()).run(0, 3, {&monitor}, count);
  EXPECT_EQ(found, 2 * before);
}

TEST(ModelContest, PrefersTheTrueModelButNoneOfTwoEqualOnes) {
  const Model truth = with({{"floor_tilt.sx", 0.015}, {"floor_tilt.sy", 0.0}});
  ModelMonitor nominal(craft(), {}), right(truth, {}), again(truth, {});
  ModelContest unequal(1.0, 10.0), equal(1.0, 10.0);
  Experiment(truth).run(0, 14, {&nominal, &right, &again}, [&](double t, const RigidState<double>& s) {
    const auto a = nominal.measure(t, s, pose(s)), b = right.measure(t, s, pose(s)),
               c = again.measure(t, s, pose(s));
    if (!a || !b || !c) return;
    unequal.add(t, *a, *b);
    equal.add(t, *c, *b);
    if (t < 4.5) {
      EXPECT_FALSE(unequal.preference());
    }
  });
  const auto found = unequal.preference();
  ASSERT_TRUE(found);
  EXPECT_TRUE(found->clear());
  EXPECT_GT(found->difference, 0);
  ASSERT_TRUE(equal.preference());
  EXPECT_FALSE(equal.preference()->clear());
}

TEST(FloorMap, HasTheMeansOfCellsWithEnoughSamples) {
  FloorMap map(0.5);
  for (int i = 0; i < 10; ++i) map.add(0.1, -0.1, i);  // mean 4.5
  for (int i = 0; i < 5; ++i) map.add(0.6, -0.2, 100);
  for (int i = 0; i < 4; ++i) map.add(3, 3, 7);  // too few
  map.add(std::nan(""), 0, 1);
  map.add(1e9, 0, 1);
  const auto cells = map.cells();
  ASSERT_EQ(cells.size(), 2u);
  EXPECT_EQ(cells[0].x, 0.25);
  EXPECT_EQ(cells[0].y, -0.25);
  EXPECT_EQ(cells[0].mean, 4.5);
  EXPECT_EQ(cells[1].mean, 100);
  EXPECT_EQ(map.large(), 4.5);  // exceeded by the largest mean only
  EXPECT_GT(FloorMap(1).large(), 0);
}

}  // namespace model_monitor_test
}  // namespace ground
