// The steps of the fit by simulation error: threads, losses, the minimiser, warm starts, uncertainty.
#include <gtest/gtest.h>

#include <Eigen/LU>
#include <Eigen/QR>
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <random>
#include <thread>

#include "../../../src/ground/src/identification/estimates.h"
#include "../../../src/ground/src/identification/parallel.h"
#include "../../../src/ground/src/identification/projected_step.h"
#include "../../../src/ground/src/identification/robust_loss.h"
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
      EXPECT_NEAR(loss.score(r), 0.5 * slope, 1e-6 * (1 + std::abs(slope)));
      EXPECT_NEAR(value[i], rho(r), 1e-9 * (1 + rho(r)));
      EXPECT_NEAR(alone[i], rho(r), 1e-9 * (1 + rho(r)));
      EXPECT_NEAR(product[i], 0.5 * slope, 1e-6 * (1 + std::abs(slope)));
      const auto root = [&](double x) { return std::copysign(std::sqrt(rho(x)), x); };
      EXPECT_NEAR(weight[i], std::pow((root(r + h) - root(r - h)) / (2 * h), 2), 1e-5) << r;
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

TEST(ProjectedStep, IsTheMinimumOfAQuadraticInABox) {
  std::mt19937 random(3);
  std::normal_distribution<double> normal;
  const auto draw = [&] { return normal(random); };
  int inside = 0;
  for (int trial = 0; trial < 200; ++trial) {
    const Eigen::MatrixXd J = Eigen::MatrixXd::NullaryExpr(6, 5, draw), A = J.transpose() * J;
    const Eigen::VectorXd g = Eigen::VectorXd::NullaryExpr(5, draw);
    const Eigen::VectorXd lower = -Eigen::VectorXd::NullaryExpr(5, draw).cwiseAbs();
    const Eigen::VectorXd upper = Eigen::VectorXd::NullaryExpr(5, draw).cwiseAbs();
    const Eigen::VectorXd step = projectedStep(A, g, lower, upper), slope = A * step + g;
    EXPECT_TRUE((step.array() >= lower.array()).all() && (step.array() <= upper.array()).all());
    for (int i = 0; i < 5; ++i) {
      if (step(i) == lower(i)) {
        EXPECT_GE(slope(i), -1e-9);
      } else if (step(i) == upper(i)) {
        EXPECT_LE(slope(i), 1e-9);
      } else {
        EXPECT_NEAR(slope(i), 0, 1e-9 * (1 + g.norm()));
        ++inside;
      }
    }
  }
  EXPECT_GT(inside, 100);
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

TEST(WarmFit, FindsWhatAColdFitFinds) {
  const RunData run = noisyRun();
  for (const Target target : {Target::kVelocities, Target::kPoses}) {
    const SimulationError problem({run}, cutWindows(run, 0, 0, 1e9, 1.25), target);
    const FitResult cold = problem.fit(start(), options());
    ASSERT_TRUE(cold.converged);
    FitOptions warm = options();
    warm.warm = true;
    warm.width = cold.width;
    Model begin = cold.model;
    for (const std::string& name : kNominal)
      begin.setValue(name, (name == "k" ? 1.06 : 0.95) * begin.value(name));
    for (const bool given : {false, true}) {
      if (given) warm.initial = cold.initial;
      const FitResult found = problem.fit(begin, warm);
      EXPECT_TRUE(found.converged);
      EXPECT_EQ(found.width, cold.width);
      expectSameFit(found, cold, 0.1);
    }
    warm.width = 0;
    expectSameFit(problem.fit(begin, warm), cold, 0.2);
  }
}

TEST(WarmFit, LeavesABoundThatItMeetsOnTheWay) {
  const RunData run = record(truth(), 6, 0.1, 2);
  const SimulationError windows = problem(run, 1.5);
  const FitResult best = windows.fit(start(), options());
  FitOptions warm = options();
  warm.warm = true;
  warm.width = best.width;
  // Factors on X_u, Y_v and k from which steps meet the bound of X_u or of Y_v.
  for (const Vector3<double>& factors :
       std::vector<Vector3<double>>{{0.3, 5, 0.6}, {0.3, 5, 1.5}, {3, 1, 0.2}, {0.03, 1, 4}}) {
    Model from = best.model;
    from.setValue("X_u", factors(0) * from.value("X_u"));
    from.setValue("Y_v", factors(1) * from.value("Y_v"));
    from.setValue("k", factors(2) * from.value("k"));
    const FitResult found = windows.fit(from, warm);
    EXPECT_TRUE(found.converged);
    expectSameFit(found, best, 0.1);
  }
}

/// The derivatives, a row for each residual.
Eigen::MatrixXd derivativesOf(const WindowResiduals& rows) {
  Eigen::MatrixXd all(rows.residuals.size(), rows.columns);
  for (Eigen::Index row = 0; row < all.rows(); ++row)
    for (int column = 0; column < rows.columns; ++column)
      all(row, column) = rows.passes[static_cast<std::size_t>(column / kDerivatives)]
                                    [static_cast<std::size_t>(row)][column % kDerivatives];
  return all;
}

TEST(WindowResiduals, DerivativesAgreeWithFiniteDifferences) {
  const RunData run = record(truth(), 2, 0.1, 4);
  const SimulationError p = problem(run, 2);
  const Model model = with({8e-4, 4e-2, 6e-2, 8e-4, 0.12});
  const std::vector<int> free = {2, 3, 4, 5, 6, 0, 1};  // with the initial velocity: two passes
  const Vector3<double> nu(0.1, -0.05, 0.3);
  const WindowResiduals exact = residualsOf(p, model, model.coordinates(), free, 0, nu, true);
  const Eigen::MatrixXd derivatives = derivativesOf(exact);
  ASSERT_TRUE(exact.finite());
  ASSERT_EQ(derivatives.cols(), 10);
  for (int j = 0; j < 10; ++j) {
    std::vector<double> up = model.coordinates(), down = up;
    Vector3<double> nu_up = nu, nu_down = nu;
    double& a = j < 7 ? up[free[j]] : nu_up(j - 7);
    double& b = j < 7 ? down[free[j]] : nu_down(j - 7);
    const double h = 1e-5 * std::max(std::abs(a), 1e-3);
    a += h;
    b -= h;
    const WindowResiduals plus = residualsOf(p, model, up, {}, 0, nu_up, false);
    const WindowResiduals minus = residualsOf(p, model, down, {}, 0, nu_down, false);
    ASSERT_TRUE(plus.finite() && minus.finite());
    const Eigen::VectorXd finite = (plus.residuals - minus.residuals) / (2 * h);
    EXPECT_LT((derivatives.col(j) - finite).norm(), 1e-5 * finite.norm() + 1e-9) << j;
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
    const Eigen::MatrixXd derivatives = derivativesOf(rows);
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
    steps.col(b) = rest.completeOrthogonalDecomposition().solve(left).topRows(n);
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

TEST(Identifiable, DirectionsWithoutInformationAreTheNullSpace) {
  std::mt19937 random(2);
  const Eigen::MatrixXd three = randomInformation(3, random);
  // Parameters 0 and 2 are known; 1 and 3 act as their sum; 4 does not act.
  Eigen::MatrixXd acts = Eigen::MatrixXd::Zero(3, 5);
  acts(0, 0) = acts(1, 2) = acts(2, 1) = acts(2, 3) = 1;
  const Eigen::MatrixXd information = acts.transpose() * three * acts;
  const Identifiable known = identifiableBy(information);
  EXPECT_EQ(known.parameter, (std::vector<bool>{true, false, true, false, false}));
  ASSERT_EQ(known.null_space.cols(), 2);
  EXPECT_LT((known.null_space.transpose() * known.null_space - Eigen::Matrix2d::Identity()).norm(), 1e-9);
  EXPECT_LT((information * known.null_space).norm(), 1e-6 * information.norm());
  const Eigen::MatrixXd within = known.directions.transpose() * information * known.directions;
  EXPECT_LT((within - Eigen::Matrix3d::Identity()).norm(), 1e-6);
  EXPECT_NEAR(known.variance()(0), three.inverse()(0, 0), 1e-6 * three.inverse()(0, 0));
}

TEST(Uncertainty, IsThatOfTheJackknifeByItsDefinition) {
  RunData run = record(truth(), 6, 0.2, 5);
  const FitResult fit = problem(run, 2).fit(start(), options());
  const Free free = makeFree(fit.model, kNominal);
  const Solution at{startOf(free), fit.initial};
  for (const double window : {0.3, 0.75, 30.0}) {
    run.scales.window = window;
    const SimulationError p = problem(run, 2);
    const Linearisation windows(p, fit.model, 1);
    const double block = std::min(window / 3, 5.95 / (4.0 * kNominal.size()));
    int blocks = 0;
    const Eigen::MatrixXd expected = jackknife(p, fit.model, free, fit.initial, block, blocks);
    const Uncertainty found = uncertainty(windows, free, at);
    EXPECT_EQ(found.blocks, blocks) << window;
    EXPECT_LT((found.covariance - expected).norm(), 1e-5 * expected.norm());
    EXPECT_EQ(found.known.null_space.cols(), 0);
  }
}

}  // namespace fit_steps_test
}  // namespace ground::detail
