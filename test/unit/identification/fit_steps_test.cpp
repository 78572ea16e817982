// The steps of the fit by simulation error: losses, starts, descents near a solution, uncertainty.
#include <gtest/gtest.h>

#include <Eigen/Core>
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <random>
#include <set>
#include <thread>

#include "../../../src/ground/src/identification/dense_algebra.h"
#include "../../../src/ground/src/identification/descent.h"
#include "../../../src/ground/src/identification/estimates.h"
#include "../../../src/ground/src/identification/information.h"
#include "../../../src/ground/src/identification/parallel.h"
#include "../../../src/ground/src/identification/robust_loss.h"
#include "../../../src/ground/src/identification/starts.h"
#include "../../../src/ground/src/identification/uncertainty.h"
#include "../../../src/ground/src/identification/window_residuals.h"
#include "../artificial_run.h"
#include "ground/model/effect_registry.h"

namespace ground::detail {
namespace fit_steps_test {

TEST(Parallel, WorksRunAtOnce) {
  std::atomic<int> begun{0};
  std::atomic<bool> together{true};
  const auto waits = [&](std::size_t) {
    ++begun;
    const auto late = std::chrono::steady_clock::now() + std::chrono::seconds(20);
    while (begun < 3 && together) {
      std::this_thread::yield();
      if (std::chrono::steady_clock::now() > late) together = false;
    }
  };
  inParallel(3, 3, waits);
  EXPECT_TRUE(together);
  std::vector<int> done(100, 0);
  for (const int threads : {0, 1, 3}) inParallel(done.size(), threads, [&](std::size_t i) { ++done[i]; });
  EXPECT_EQ(done, std::vector<int>(100, 3));
}

TEST(RobustLoss, IsThePseudoHuberLossWithItsDerivatives) {
  for (const double delta : {0.1, 1.0, 3.0, kInfinity}) {
    const RobustLoss loss{delta};
    const auto rho = [&](double r) {
      return std::isinf(delta) ? r * r : 2 * delta * delta * (std::sqrt(1 + std::pow(r / delta, 2)) - 1);
    };
    const std::vector<double> residuals = {-7, -1, -0.3, 0, 0.05, 0.5, 2, 40};
    const int count = static_cast<int>(residuals.size());
    std::vector<double> weight(residuals.size()), product = weight, value = weight, alone = weight;
    loss.weighing()(residuals.data(), count, weight.data(), product.data(), value.data());
    loss.weighing()(residuals.data(), count, nullptr, nullptr, alone.data());
    for (std::size_t i = 0; i < residuals.size(); ++i) {
      const double r = residuals[i], h = 1e-4 * (1 + std::abs(r));
      const double slope = (rho(r + h) - rho(r - h)) / (2 * h);
      EXPECT_NEAR(std::pow(loss(r), 2), rho(r), 1e-9 * (1 + rho(r)));
      EXPECT_EQ(loss(r) < 0, r < 0);
      EXPECT_NEAR(loss.derivative(r), (loss(r + h) - loss(r - h)) / (2 * h), 1e-6) << r;
      EXPECT_NEAR(loss.score(r), 0.5 * slope, 1e-6 * (1 + std::abs(slope)));
      EXPECT_NEAR(value[i], rho(r), 1e-9 * (1 + rho(r)));
      EXPECT_NEAR(alone[i], rho(r), 1e-9 * (1 + rho(r)));
      EXPECT_NEAR(product[i], 0.5 * slope, 1e-6 * (1 + std::abs(slope)));
      EXPECT_NEAR(weight[i], std::pow(loss.derivative(r), 2), 1e-9);
      if (std::isinf(delta)) continue;
      const double bend = (rho(r + h) - 2 * rho(r) + rho(r - h)) / (h * h);
      EXPECT_NEAR(loss.curvature(r, delta), 0.5 * bend, 1e-4) << r;
    }
    // Spread over a greater width, the curvature has the same sum.
    if (std::isinf(delta)) continue;
    for (const double width : {delta, 4 * delta}) {
      double sum = 0;
      for (double x = -100 * width; x < 100 * width; x += 0.01 * width)
        sum += 0.01 * width * loss.curvature(x, width);
      EXPECT_NEAR(sum, 2 * delta, 0.001 * delta);
    }
    EXPECT_LT(loss.curvature(0, 4 * delta), loss.curvature(0, delta));
  }
  EXPECT_EQ(RobustLoss().curvature(3, kInfinity), 1);
}

void expectSameFit(const FitResult& found, const FitResult& expected, double tolerance) {
  for (std::size_t i = 0; i < expected.parameters.size(); ++i) {
    const FittedParameter &a = found.parameters[i], &b = expected.parameters[i];
    EXPECT_NEAR(a.value, b.value, tolerance * std::min(b.deviation, std::abs(b.value)) + 1e-9) << b.name;
  }
  EXPECT_NEAR(found.objective, expected.objective, 1e-3 * expected.objective);
}

/// A run of the thesis with noise of the velocities and of the poses.
RunData noisyRun() {
  RunData run = record(truth(), 5, 0.2, 3);
  run.noise = {1e-3, 1e-3, 1e-2};
  std::mt19937 random(2);
  std::normal_distribution<double> normal;
  for (Eigen::Index i = 0; i < run.eta.rows(); ++i)
    for (int c = 0; c < 3; ++c) run.eta(i, c) += run.noise(c) * normal(random);
  return run;
}

TEST(NearFit, FindsWhatAFitFromFarAwayFinds) {
  const RunData run = noisyRun();
  for (const Target target : {Target::kVelocities, Target::kPoses}) {
    const SimulationError problem({run}, cutWindows(run, 0, 0, 1e9, 1.25), target);
    const FitResult far = problem.fit(start(), options());
    ASSERT_TRUE(far.converged);
    FitOptions near = options();
    near.near = true;
    near.width = far.width;
    Model begin = far.model;
    for (const std::string& name : kNominal)
      begin.setValue(name, (name == "k" ? 1.06 : 0.95) * begin.value(name));
    for (const bool given : {false, true}) {
      if (given) near.initial = far.initial;
      const FitResult found = problem.fit(begin, near);
      EXPECT_TRUE(found.converged) << found.message;
      EXPECT_EQ(found.width, far.width);
      expectSameFit(found, far, 0.1);
    }
    near.width = 0;
    expectSameFit(problem.fit(begin, near), far, 0.2);
  }
}

std::vector<double> scaledStart(const Free& free) {
  std::vector<double> scaled;
  for (std::size_t i = 0; i < free.index.size(); ++i)
    scaled.push_back(free.base[static_cast<std::size_t>(free.index[i])] / free.scale[i]);
  return scaled;
}

TEST(StartKept, MovesAlongDirectionsWithoutInformationToTheStart) {
  const SimulationError p = problem(spinningRun());
  const Model guess = with({1.5e-3, 0.03, 0.03, 2e-3, 0.2});
  const Free free = makeFree(guess, kNominal);
  Linearisation windows(p, guess, 1);
  FitOptions o = options();
  Solution found = descend(windows, free, {kInfinity}, o, scaledStart(free), measuredInitials(p));
  const Eigen::MatrixXd unseen = uncertainty(windows, free, found, 0.5).unseen;
  ASSERT_EQ(unseen.cols(), 2);  // k, and a common factor on I_z and N_r
  found.scaled[4] *= 1.7;       // does not change the motion
  const auto expectKept = [&](const Solution& kept, const std::vector<double>& at, double close) {
    EXPECT_NEAR(kept.scaled[4], at[4], 1e-14);
    EXPECT_NE(kept.scaled[0] == at[0], kept.scaled[3] == at[3]) << "one of both is the start's";
    // The coordinate of I_z is its reciprocal.
    EXPECT_NEAR(kept.scaled[3] * kept.scaled[0] / (found.scaled[3] * found.scaled[0]), 1, close);
    for (const std::size_t i : {1u, 2u}) EXPECT_NEAR(kept.scaled[i] / found.scaled[i], 1, close) << i;
    EXPECT_NEAR(kept.cost / found.cost, 1, close);
    EXPECT_GT(kept.iterations, found.iterations);
  };
  expectKept(startKept(windows, free, unseen, o, found), scaledStart(free), 1e-4);
  // To a close start, the direction leads without a descent.
  Free close = free;
  std::vector<double> at = found.scaled;
  for (const std::size_t i : {0u, 3u, 4u}) {
    at[i] *= i == 0 ? 0.975 : 1.02;
    close.base[static_cast<std::size_t>(close.index[i])] = at[i] * close.scale[i];
  }
  at = scaledStart(close);
  o.max_iterations = 0;
  const Solution kept = startKept(windows, close, unseen, o, found);
  EXPECT_EQ(kept.iterations, found.iterations + 1);
  expectKept(kept, at, 1e-3);
  // Data that rule out the start keep the solution.
  close.base[static_cast<std::size_t>(close.index[0])] *= 3;
  close.base[static_cast<std::size_t>(close.index[3])] *= 3;
  EXPECT_EQ(startKept(windows, close, unseen, o, found).scaled, found.scaled);
}

/// Thrust that grows with speed acts like a negative damping, which the model does not allow.
SimulationError driven(bool allowed) {
  Model model = truth();
  if (!allowed) {
    model.setValue("X_u", 0);
    model.addEffect(makeEffect("thrust_speed_loss"));
    model.setValue("thrust_speed_loss.c", -0.05);
  }
  return problem(record(model, 6, 0.1, 2), 1.5);
}

TEST(NearFit, LeavesABoundThatItMetOnTheWay) {
  const SimulationError problem = driven(true);
  const FitResult far = problem.fit(start(), options());
  Free free = makeFree(far.model, kNominal);
  Linearisation windows(problem, far.model, 1);
  FitOptions near = options();
  near.near = true;
  const Solution best = descend(windows, free, {kInfinity}, near, scaledStart(free), far.initial);
  ASSERT_GT(best.scaled[1], 0.1);
  // Factors on X_u, Y_v and k from which steps meet the bound of X_u or of Y_v.
  for (const Vector3<double>& factors :
       std::vector<Vector3<double>>{{0.3, 5, 0.6}, {0.3, 5, 1.5}, {3, 1, 0.2}, {0.03, 1, 4}}) {
    std::vector<double> scaled = best.scaled;
    scaled[1] *= factors(0);
    scaled[2] *= factors(1);
    scaled[4] *= factors(2);
    const Solution found = descend(windows, free, {kInfinity}, near, scaled, far.initial);
    EXPECT_TRUE(found.converged);
    EXPECT_NEAR(found.cost, best.cost, 1e-4 * best.cost);
    for (std::size_t i = 0; i < scaled.size(); ++i)
      EXPECT_NEAR(found.scaled[i] / best.scaled[i], 1, 1e-2) << i;
  }
}

/// The jackknife by its definition: each block of rows is left out once, and the rest is solved for
/// the parameters and all initial states together.
Eigen::MatrixXd jackknife(const SimulationError& problem, const Model& model, const Free& free,
                          const Initials& initial, double block, int& blocks) {
  const auto n = static_cast<Eigen::Index>(free.index.size());
  const Eigen::Index k = problem.initialSize();
  const auto windows = static_cast<Eigen::Index>(initial.size());
  Eigen::MatrixXd J(0, n + k * windows);
  Eigen::VectorXd r(0);
  std::vector<int> block_of;
  blocks = 0;
  for (Eigen::Index w = 0; w < windows; ++w) {
    const WindowResiduals rows = residualsOf(problem, model, model.coordinates(), free.index,
                                             static_cast<int>(w), initial[static_cast<std::size_t>(w)], true);
    const Eigen::MatrixXd derivatives = rows.derivatives();
    const Eigen::Index count = rows.residuals.size(), before = r.size();
    J.conservativeResize(before + count, Eigen::NoChange);
    J.bottomRows(count).setZero();
    r.conservativeResize(before + count);
    r.tail(count) = rows.residuals;
    for (Eigen::Index j = 0; j < n; ++j)
      J.col(j).tail(count) = free.scale[static_cast<std::size_t>(j)] * derivatives.col(j);
    J.block(before, n + k * w, count, k) = derivatives.middleCols(n, k);
    const Window& span = problem.windows()[static_cast<std::size_t>(w)];
    const auto& times = problem.runs()[0].times;
    const int parts =
        std::max(1, static_cast<int>(std::lround((times[span.last] - times[span.first]) / block)));
    const Eigen::Index samples = count / 3;
    for (int p = 0; p < parts; ++p)
      for (Eigen::Index i = samples * p / parts; i < samples * (p + 1) / parts; ++i)
        for (int c = 0; c < 3; ++c) block_of.push_back(blocks + p);
    blocks += parts;
  }
  Eigen::MatrixXd steps(n, blocks);
  for (int b = 0; b < blocks; ++b) {
    Eigen::MatrixXd rest = J;
    Eigen::VectorXd left = r;
    for (Eigen::Index i = 0; i < r.size(); ++i)
      if (block_of[static_cast<std::size_t>(i)] == b) {
        rest.row(i).setZero();
        left(i) = 0;
      }
    steps.col(b) = leastSquares(rest, left).topRows(n);
  }
  const Eigen::MatrixXd centred = steps.colwise() - steps.rowwise().mean();
  return (blocks - 1.0) / blocks * centred * centred.transpose();
}

Eigen::MatrixXd randomInformation(Eigen::Index n, std::mt19937& random) {
  std::normal_distribution<double> normal;
  Eigen::MatrixXd J(3 * n, n);
  for (Eigen::Index i = 0; i < J.size(); ++i) J(i) = normal(random);
  for (Eigen::Index j = 0; j < n; ++j) J.col(j) *= std::pow(10.0, static_cast<double>(j % 3));
  return J.transpose() * J;
}

TEST(Known, DirectionsWithoutInformationAreUnseenAndTheirParametersNotIdentified) {
  std::mt19937 random(2);
  Eigen::MatrixXd information = Eigen::MatrixXd::Zero(5, 5);
  const Eigen::MatrixXd three = randomInformation(3, random);
  // Parameters 0, 2, 4 are known; 1 and 3 act as their sum, which 0 knows too.
  Eigen::MatrixXd acts = Eigen::MatrixXd::Zero(3, 5);
  acts(0, 0) = acts(1, 2) = acts(2, 1) = acts(2, 3) = 1;
  information = acts.transpose() * three * acts;
  information(4, 4) = 1e-3;  // hardly known: a deviation of 32 of its scale
  const Known known = knownBy(information);
  EXPECT_EQ(known.identified, (std::vector<bool>{true, false, true, false, false}));
  ASSERT_EQ(known.unseen.cols(), 1);
  EXPECT_NEAR(known.unseen.norm(), 1, 1e-9);
  EXPECT_LT((information * known.unseen).norm(), 1e-6 * information.norm());
  EXPECT_NEAR(known.unseen(1) + known.unseen(3), 0, 1e-9);
  EXPECT_NEAR(known.variance(4), 1e3, 1e-3);
  information(4, 4) = 2e-3;
  EXPECT_TRUE(knownBy(information).identified[4]);
}

TEST(Estimates, IntervalsAreSymmetricInTheCoordinateAndEndAtTheBounds) {
  Model model = truth();
  model.addEffect(makeEffect("battery_sag"));  // its coordinate is the rate 1 / tau
  model.setValue("battery_sag.tau", 50);
  const std::vector<std::string> names = {"X_u", "battery_sag.tau"};
  const Free free = makeFree(model, names);
  const auto infos = model.parameters();
  for (std::size_t i = 0; i < 2; ++i) {
    const ParameterInfo& info = infos[static_cast<std::size_t>(free.index[i])];
    const double value = model.value(names[i]), at = info.toCoordinate(value), scaled = at / free.scale[i],
                 deviation = 0.1 * scaled;
    const FittedParameter found = estimateOf(info, free, i, scaled, deviation, 2, 7);
    EXPECT_NEAR(found.value, value, 1e-12 * value);
    EXPECT_EQ(found.start, 7);
    EXPECT_TRUE(found.identified);
    EXPECT_FALSE(found.at_bound);
    const double one = info.fromCoordinate(0.8 * at), other = info.fromCoordinate(1.2 * at);
    EXPECT_NEAR(found.lower, std::min(one, other), 1e-9 * value);
    EXPECT_NEAR(found.upper, std::max(one, other), 1e-9 * value);
    EXPECT_NEAR(found.deviation, 0.1 * value, 1e-9 * value);  // to first order
    // Twelve deviations reach beyond zero, which is a bound of both coordinates.
    const FittedParameter wide = estimateOf(info, free, i, scaled, deviation, 12, 7);
    EXPECT_NEAR(i == 0 ? wide.lower : 1 / wide.upper, 0, 1e-6);
    const FittedParameter unknown = estimateOf(info, free, i, scaled, kInfinity, 2, 7);
    EXPECT_FALSE(unknown.identified);
    EXPECT_EQ(unknown.lower, info.lower);
    EXPECT_EQ(unknown.upper, info.upper);
    const FittedParameter bound = estimateOf(info, free, i, 0, deviation, 2, 7);
    EXPECT_TRUE(bound.at_bound);
  }
}

TEST(Uncertainty, IsThatOfTheJackknifeByItsDefinition) {
  const SimulationError p = problem(record(truth(), 6, 0.2, 5), 2);
  const FitResult fit = p.fit(start(), options());
  const Free free = makeFree(fit.model, kNominal);
  Solution at;
  at.initial = fit.initial;
  for (std::size_t i = 0; i < kNominal.size(); ++i)
    at.scaled.push_back(free.base[free.index[i]] / free.scale[i]);
  Linearisation windows(p, fit.model, 1);
  for (const double asked : {0.1, 0.25, 10.0}) {
    const double block = std::min(asked, 5.95 / (4.0 * kNominal.size()));
    int blocks = 0;
    const Eigen::MatrixXd expected = jackknife(p, fit.model, free, fit.initial, block, blocks);
    const Uncertainty found = uncertainty(windows, free, at, asked);
    EXPECT_EQ(found.blocks, blocks) << asked;
    EXPECT_LT((found.covariance - expected).norm(), 1e-5 * expected.norm());
    EXPECT_EQ(found.unseen.cols(), 0);
    for (const bool identified : found.identified) EXPECT_TRUE(identified);
  }
}

}  // namespace fit_steps_test
}  // namespace ground::detail
