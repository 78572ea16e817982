// Fitting by simulation error on artificial data (thesis 3.3.2).
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "ground/control/prbs.h"
#include "ground/identification/simulation_error.h"
#include "ground/model/effect_registry.h"
#include "ground/model/model_file.h"

namespace ground {
namespace {

const std::vector<std::string> kFive = {"I_z", "X_u", "Y_v", "N_r", "k"};

Model with(const std::vector<double>& five) {
  Model model = loadModel("cfg/hovercraft/tiny_whoover.yaml");
  for (std::size_t i = 0; i < kFive.size(); ++i) model.setValue(kFive[i], five[i]);
  return model;
}

Model truth() { return with({1e-3, 5e-2, 5e-2, 1e-3, 0.1}); }  // table 3.1
Model start() { return with({0.2, 0.2, 0.2, 0.2, 0.2}); }

/// PRBS {0, 1} at 20 Hz from rest, sampled at 100 Hz. The noise's standard deviation is epsilon
/// times that of each velocity, independent in every channel: (3.5) as it must be meant, for it
/// divides by sigma and gives all channels the same random number.
RunData record(const Model& model, double duration, double epsilon, unsigned seed) {
  PrbsParams params;
  params.clock = 20;
  params.duration = duration;
  const PrbsSignal prbs(makePrbs(9, seed), params);
  RunData run;
  run.name = "artificial";
  for (double t = 0; t < duration; t = prbs.nextChange(t))
    run.inputs.add(t, prbs.at(t).x(), prbs.at(t).y(), 1);
  const Dynamics<double> dynamics(model);
  Simulation<double> simulation(dynamics, run.inputs, {}, 0);
  const int samples = static_cast<int>(duration * 100) + 1;
  run.eta.resize(samples, 3);
  run.nu.resize(samples, 3);
  for (int i = 0; i < samples; ++i) {
    run.times.push_back(i * 0.01);
    simulation.advance(i * 0.01);
    run.eta.row(i) = simulation.measure().eta;
    run.nu.row(i) = simulation.measure().nu;
  }
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  const Vector3<double> mean = run.nu.colwise().mean();
  const Vector3<double> sigma =
      (run.nu.rowwise() - mean.transpose()).array().square().colwise().mean().sqrt();
  for (int i = 0; i < samples; ++i)
    for (int c = 0; c < 3; ++c) run.nu(i, c) += epsilon * sigma(c) * normal(random);
  return run;
}

SimulationError problem(const RunData& run, double window = 4.0) {
  return SimulationError({run}, cutWindows(run, 0, 0, 1e9, window));
}

FitOptions options(FitOptions::Objective objective = FitOptions::Objective::kLeastSquares) {
  FitOptions o;
  o.free = kFive;
  o.objective = objective;
  return o;
}

double worst(const FitResult& result) {
  double largest = 0;
  for (const FittedParameter& p : result.parameters)
    largest = std::max(largest, std::abs(p.value / truth().value(p.name) - 1));
  return largest;
}

TEST(Fit, FindsTheTruthInCleanDataFromFarAway) {
  for (unsigned seed : {1u, 2u, 3u, 4u, 5u}) {
    const FitResult result = problem(record(truth(), 4, 0, seed)).fit(start(), options());
    EXPECT_LT(worst(result), 1e-4) << "seed " << seed;
    EXPECT_LT(result.objective_after, 1e-4);
    EXPECT_GT(result.objective_before, 0.5);
  }
}

TEST(Fit, FindsTheTruthWithTheThesisObjective) {
  const auto thesis = options(FitOptions::Objective::kThesis);
  EXPECT_LT(worst(problem(record(truth(), 4, 0, 1)).fit(start(), thesis)), 1e-4);
  EXPECT_LT(worst(problem(record(truth(), 4, 0.1, 1)).fit(start(), thesis)), 0.05);
}

TEST(Fit, MinimisesTheThesisObjectiveBetterThanSquaresDo) {
  const SimulationError p = problem(record(truth(), 4, 0.3, 3));
  const double thesis = p.fit(start(), options(FitOptions::Objective::kThesis)).objective_after;
  EXPECT_LE(thesis, p.fit(start(), options()).objective_after + 1e-3);
}

TEST(Fit, WithstandsNoise) {
  struct Case {
    double epsilon, median;
  };
  int all_covered = 0, all_intervals = 0;
  for (const Case& c : {Case{0.1, 0.02}, Case{0.3, 0.06}, Case{0.5, 0.10}}) {
    std::vector<double> errors;
    int covered = 0, intervals = 0;
    for (unsigned seed = 1; seed <= 40; ++seed) {
      const FitResult result = problem(record(truth(), 4, c.epsilon, seed)).fit(start(), options());
      errors.push_back(worst(result));
      for (const FittedParameter& p : result.parameters) {
        ++intervals;
        const double value = truth().value(p.name);
        covered += p.lower <= value && value <= p.upper;
      }
    }
    std::sort(errors.begin(), errors.end());
    EXPECT_LT(errors[errors.size() / 2], c.median) << "epsilon " << c.epsilon;
    all_covered += covered;
    all_intervals += intervals;
  }
  RecordProperty("coverage_percent", 100 * all_covered / all_intervals);
  EXPECT_GE(all_covered, 0.90 * all_intervals);
  EXPECT_LE(all_covered, 0.99 * all_intervals);
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
  EXPECT_TRUE(result.converged) << result.message;
}

TEST(Fit, FitsEffectsToo) {
  Model model = truth();
  model.addEffect(makeEffect("motor_lag"));
  model.addEffect(makeEffect("battery_sag"));
  model.setValue("motor_lag.tau", 0.06);
  model.setValue("battery_sag.tau", 40);
  const RunData run = record(model, 6, 0.02, 1);
  Model guess = truth();
  guess.addEffect(makeEffect("motor_lag"));
  guess.addEffect(makeEffect("battery_sag"));
  FitOptions o = options();
  o.free.insert(o.free.end(), {"motor_lag.tau", "battery_sag.tau"});
  const FitResult result = problem(run, 6).fit(guess, o);
  EXPECT_NEAR(result.model.value("motor_lag.tau"), 0.06, 0.006);
  EXPECT_NEAR(result.model.value("battery_sag.tau"), 40, 12);
  EXPECT_LT(result.objective_after, 0.06);
}

TEST(Fit, DerivativesAgreeWithFiniteDifferences) {
  const RunData run = record(truth(), 2, 0.1, 4);
  const SimulationError p = problem(run, 2);
  const Model model = with({8e-4, 4e-2, 6e-2, 8e-4, 0.12});
  const std::vector<int> free = {2, 3, 4, 5, 6, 0, 1};  // with the initial velocity: two passes
  const Vector3<double> nu(0.1, -0.05, 0.3);
  Eigen::VectorXd r, plus, minus;
  Eigen::MatrixXd J;
  ASSERT_TRUE(p.residuals(model, model.coordinates(), free, 0, nu, r, &J));
  ASSERT_EQ(J.cols(), 10);
  for (int j = 0; j < 10; ++j) {
    std::vector<double> up = model.coordinates(), down = up;
    Vector3<double> nu_up = nu, nu_down = nu;
    double& a = j < 7 ? up[free[j]] : nu_up(j - 7);
    double& b = j < 7 ? down[free[j]] : nu_down(j - 7);
    const double h = 1e-5 * std::max(std::abs(a), 1e-3);
    a += h;
    b -= h;
    ASSERT_TRUE(p.residuals(model, up, free, 0, nu_up, plus, nullptr));
    ASSERT_TRUE(p.residuals(model, down, free, 0, nu_down, minus, nullptr));
    const Eigen::VectorXd finite = (plus - minus) / (2 * h);
    EXPECT_LT((J.col(j) - finite).norm(), 1e-5 * finite.norm() + 1e-9) << j;
  }
}

TEST(Fit, RefusesWhatCannotBeToldApart) {
  const SimulationError p = problem(record(truth(), 4, 0, 1));
  FitOptions o = options();
  o.free.push_back("m");
  EXPECT_THROW(p.fit(start(), o), std::invalid_argument);
  o.free = {};
  EXPECT_THROW(p.fit(start(), o), std::invalid_argument);
  o.free = {"k", "k"};
  EXPECT_THROW(p.fit(start(), o), std::invalid_argument);
  o.free = {"motor_lag.tau"};
  EXPECT_THROW(p.fit(start(), o), std::invalid_argument);
}

TEST(Windows, CoverTheRunAndSpareItsGaps) {
  RunData run = record(truth(), 4, 0, 1);
  EXPECT_EQ(cutWindows(run, 0, 0, 1e9, 4.0).size(), 1u);
  EXPECT_EQ(cutWindows(run, 0, 0, 1e9, 1.0).size(), 4u);
  EXPECT_EQ(cutWindows(run, 0, 1.0, 3.0, 1.0).size(), 2u);
  EXPECT_TRUE(cutWindows(run, 0, 0, 0.02, 1.0).empty());
  for (std::size_t i = 200; i < run.times.size(); ++i) run.times[i] += 0.5;
  for (const Window& w : cutWindows(run, 0, 0, 1e9, 1.0))
    EXPECT_FALSE(w.first < 200 && w.last >= 200);
  EXPECT_THROW(SimulationError({run}, {}), std::invalid_argument);
}

}  // namespace
}  // namespace ground

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
