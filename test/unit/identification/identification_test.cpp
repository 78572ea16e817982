// Fitting by simulation error on artificial data (thesis 3.3.2).
#include "ground/identification/identification.h"

#include <gtest/gtest.h>

#include <cmath>

#include "../artificial_run.h"
#include "../crafts.h"

namespace ground {
namespace identification_test {

TEST(Fit, FindsTheTruthWithTheThesisObjective) {
  const auto thesis = options(FitOptions::Objective::kThesis);
  EXPECT_LT(worst(problem(record(truth(), 4, 0, 1)).fit(start(), thesis)), 1e-4);
  EXPECT_LT(worst(problem(record(truth(), 4, 0.1, 1)).fit(start(), thesis)), 0.05);
}

TEST(Fit, MinimisesTheThesisObjective) {
  const SimulationError p = problem(record(truth(), 4, 0.3, 3));
  const FitOptions thesis = options(FitOptions::Objective::kThesis);
  const FitResult fit = p.fit(start(), thesis);
  EXPECT_LT(fit.objective, p.fit(start(), options()).objective);
  // No step of a parameter makes it smaller, even with the best initial velocity.
  for (const std::string& name : kNominal)
    for (const double factor : {0.9, 0.97, 0.99, 1.01, 1.03, 1.1}) {
      Model other = fit.model;
      other.setValue(name, factor * other.value(name));
      EXPECT_GT(p.objective(p.simulate(other, thesis.objective)), fit.objective - 1e-4)
          << name << " times " << factor;
    }
}

/// Coverage of the 95% intervals over 40 fits.
Coverage coverage(FitOptions::Objective objective, double duration, double window, double memory) {
  Coverage result;
  for (unsigned seed = 1; seed <= 40; ++seed) {
    const RunData run = record(truth(), duration, 0.3, seed, memory);
    result.add(problem(run, window).fit(start(), options(objective)));
  }
  return result;
}

TEST(Intervals, HoldTheTruthWhenNoiseIsCorrelated) {
  const double covered = coverage(FitOptions::Objective::kLeastSquares, 12, 1.5, 0.9).percent();
  RecordProperty("coverage_percent", std::to_string(covered));
  EXPECT_GE(covered, 90);
  EXPECT_LE(covered, 99.5);
}

TEST(Intervals, AreTheWholeRangeOfUnidentifiableParameters) {
  const Model guess = with({1.5e-3, 0.03, 0.03, 2e-3, 0.2});
  const FitResult result = problem(spinningRun()).fit(guess, options());
  for (const FittedParameter& p : result.parameters) {
    const bool seen = p.name == "X_u" || p.name == "Y_v";
    EXPECT_EQ(p.identified, seen) << p.name;
    if (seen) {
      EXPECT_NEAR(p.value, 0.05, 0.003) << p.name;
    } else {
      EXPECT_TRUE(std::isinf(p.upper)) << p.name;
    }
  }
  EXPECT_DOUBLE_EQ(result.model.value("k"), 0.2) << "k keeps its start value";
  EXPECT_NEAR(result.model.value("N_r") / result.model.value("I_z"), 1.0, 0.01);
  const auto kept = [&](const std::string& name) {
    return std::abs(result.model.value(name) / guess.value(name) - 1) < 1e-14;
  };
  EXPECT_NE(kept("N_r"), kept("I_z")) << "one of the two keeps its start value";
}

TEST(Fit, EndsAtOnePointEvenIfAParameterIsAtItsBound) {
  // Thrust that grows with speed acts like a negative damping, which the model does not allow.
  const Model driven = withValues(truth(), {{"X_u", 0}, {"thrust_speed_loss.c", -0.05}});
  const SimulationError p = problem(record(driven, 6, 0.1, 2), 1.5);
  const FitResult given = p.fit(start(), options());
  EXPECT_TRUE(given.converged);
  EXPECT_EQ(given.model.value("X_u"), 0);
  const std::vector<std::vector<double>> starts = {
      {1e-3, 0, 0.05, 1e-3, 0.1}, {2e-3, 0.1, 0.1, 2e-3, 0.2}, {5e-4, 0.02, 0.02, 1e-3, 0.07}};
  for (const std::vector<double>& from : starts) {
    const FitResult other = p.fit(with(from), options());
    for (const std::string& name : kNominal)
      EXPECT_NEAR(other.model.value(name), given.model.value(name), 1e-4 * given.model.value(name) + 1e-12)
          << name;
  }
}

TEST(Fit, TakesTheBestOfSeveralStarts) {
  const SimulationError p = problem(record(truth(), 4, 0.1, 1));
  FitOptions o = options();
  o.starts = 6;
  const FitResult several = p.fit(start(), o), one = p.fit(start(), options());
  EXPECT_EQ(several.starts, 6);
  EXPECT_GE(several.starts_at_best, 3);
  EXPECT_LE(several.objective, one.objective + 1e-6);
  EXPECT_EQ(one.starts, 1);
  o.starts = 0;
  EXPECT_THROW(p.fit(start(), o), std::invalid_argument);
}

TEST(Fit, ThrowsIfTheModelCannotBeSimulated) {
  const RunData run = record(truth(), 4, 0.1, 1);
  const Model wild = withValues(truth(), {{"I_z", 1e-300}, {"N_r", 1e300}});
  EXPECT_THROW(problem(run).fit(wild, options()), std::runtime_error);
  EXPECT_THROW(problem(run).simulate(wild), std::runtime_error);
}

TEST(Fit, WithstandsOutliers) {
  RunData run = record(truth(), 4, 0.05, 2);
  for (int i = 20; i < 400; i += 37) run.nu.row(i) *= -5;
  EXPECT_LT(worst(problem(run).fit(start(), options())), 0.05);
}

TEST(Fit, FitsSeveralRunsAndWindowsAtOnce) {
  const RunData a = record(truth(), 4, 0.1, 1), b = record(truth(), 5, 0.1, 2);
  std::vector<Window> windows = cutWindows(a, 0, 0, 1e9, 1.5);
  for (const Window& w : cutWindows(b, 1, 0, 1e9, 1.5)) windows.push_back(w);
  const FitResult result = SimulationError({a, b}, windows).fit(start(), options());
  EXPECT_LT(worst(result), 0.03);
  EXPECT_TRUE(result.converged);
}

TEST(Fit, FitsParametersOfEffects) {
  const RunData run =
      record(withValues(truth(), {{"motor_lag.tau", 0.06}, {"battery_sag.tau", 40}}), 6, 0.02, 1);
  Model guess = truth();
  guess.addEffect(makeEffect("motor_lag"));
  guess.addEffect(makeEffect("battery_sag"));
  FitOptions o = options();
  o.free.insert(o.free.end(), {"motor_lag.tau", "battery_sag.tau"});
  const FitResult result = problem(run, 6).fit(guess, o);
  EXPECT_NEAR(result.model.value("motor_lag.tau"), 0.06, 0.006);
  EXPECT_NEAR(result.model.value("battery_sag.tau"), 40, 12);
  EXPECT_LT(result.objective, 0.06);
}

TEST(Simulation, OfTheTrueModelIsTheRunInEachWindow) {
  const RunData run = record(truth(), 8, 0, 1);
  const SimulationError windows = problem(run, 1.5);
  const WindowSimulation found = windows.simulate(truth());
  ASSERT_EQ(found.nu.size(), windows.windows().size());
  for (std::size_t w = 0; w < found.nu.size(); ++w) {
    const Eigen::Index first = windows.windows()[w].first, count = found.nu[w].rows();
    EXPECT_LT((found.nu[w] - run.nu.middleRows(first, count)).norm(), 1e-6) << w;
    EXPECT_LT((found.eta[w] - run.eta.middleRows(first, count)).norm(), 1e-5) << w;
  }
  EXPECT_LT(windows.objective(found), 1e-6);
}

TEST(Identification, TheHeaderSufficesForItsExample) {
  RunData run = record(truth(), 6, 0.02, 1);
  const SimulationError problem({run}, cutWindows(run, 0, 0, run.times.back(), 1.5));
  FitOptions options;
  options.free = {"k", "I_z"};
  const FitResult fit = problem.fit(with({2e-3, 5e-2, 5e-2, 1e-3, 0.2}), options);
  ASSERT_EQ(fit.parameters.size(), 2u);
  EXPECT_NEAR(fit.parameters[0].value, 0.1, 0.005);
  EXPECT_NEAR(fit.parameters[1].value, 1e-3, 5e-5);
  // Poses have no noise, and no wrench is missing.
  const GreyBox box({run}, fit.model.body);
  const SmoothedWrench missing = box.smooth(box.fit(box.start(fit.model), {}).point, 0, 25);
  EXPECT_LT(missing.wrench.leftCols<2>().cwiseAbs().mean(), 0.05 * fit.parameters[0].value);
}

TEST(Windows, CoverTheRunWithoutItsGaps) {
  RunData run = record(truth(), 4, 0, 1);
  EXPECT_EQ(cutWindows(run, 0, 0, 1e9, 4.0).size(), 1u);
  EXPECT_EQ(cutWindows(run, 0, 0, 1e9, 1.0).size(), 4u);
  EXPECT_EQ(cutWindows(run, 0, 1.0, 3.0, 1.0).size(), 2u);
  EXPECT_TRUE(cutWindows(run, 0, 0, 0.02, 1.0).empty());
  EXPECT_EQ(cutWindows(run, 0, 0, 1e9, 4.0)[0].first, 0);
  // Five samples do not identify an initial velocity, six do.
  for (const int samples : {5, 6}) {
    const double last = run.times[static_cast<std::size_t>(samples - 1)];
    EXPECT_EQ(cutWindows(run, 0, 0, last, last).size(), samples < 6 ? 0u : 1u);
  }
  for (std::size_t i = 200; i < run.times.size(); ++i) run.times[i] += 0.5;
  for (const Window& w : cutWindows(run, 0, 0, 1e9, 1.0)) EXPECT_FALSE(w.first < 200 && w.last >= 200);
  EXPECT_THROW(SimulationError({run}, {}), std::invalid_argument);
}

}  // namespace identification_test
}  // namespace ground
