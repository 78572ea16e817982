// Whitening against the covariance that it stands for, and a fit under it.
#include "../../src/ground/src/identification/whitening.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <random>

namespace ground {
namespace {

std::vector<double> unevenTimes(int count) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> step(0.005, 0.03);
  std::vector<double> times = {1.0};
  while (static_cast<int>(times.size()) < count) times.push_back(times.back() + step(random));
  return times;
}

/// Covariance of noise and twice integrated white noise that starts at rest at the first time.
Eigen::MatrixXd covariance(const std::vector<double>& times, double noise, double disturbance) {
  const auto n = static_cast<Eigen::Index>(times.size());
  Eigen::MatrixXd K(n, n);
  for (Eigen::Index i = 0; i < n; ++i)
    for (Eigen::Index j = 0; j < n; ++j) {
      const double s = std::min(times[i], times[j]) - times[0];
      const double t = std::max(times[i], times[j]) - times[0];
      K(i, j) = disturbance * disturbance * s * s * (3 * t - s) / 6 + (i == j) * noise * noise;
    }
  return K;
}

TEST(Whitening, IsTheInverseOfTheCholeskyFactor) {
  const int n = 60;
  const std::vector<double> times = unevenTimes(n);
  const Vector3<double> noise(3e-4, 4e-4, 5e-3), disturbance(0.01, 0.03, 0.4);
  const Whitening<double> whitening = driftingErrors(times, 0, n - 1, noise, disturbance);
  const int columns = Lanes::kCount;
  const Eigen::MatrixXd rows = Eigen::MatrixXd::Random(3 * n, columns);
  Eigen::MatrixXd expected = rows;
  for (int c = 0; c < 3; ++c) {
    const Eigen::MatrixXd L = covariance(times, noise(c), disturbance(c)).llt().matrixL();
    for (int column = 0; column < columns; ++column) {
      Eigen::VectorXd channel(n);
      for (int i = 0; i < n; ++i) channel(i) = rows(3 * i + c, column);
      channel = L.triangularView<Eigen::Lower>().solve(channel);
      for (int i = 0; i < n; ++i) expected(3 * i + c, column) = channel(i);
    }
    for (int i = 0; i < n; ++i) EXPECT_NEAR(whitening.over_deviation[i][c] * L(i, i), 1, 1e-9);
  }
  Innovations<double, double> one(whitening);
  Innovations<double, Lanes> several(whitening);
  Eigen::MatrixXd found = rows;
  Eigen::VectorXd alone = rows.col(3);
  for (int i = 0; i < n; ++i)
    for (int c = 0; c < 3; ++c) {
      one.apply(i, c, alone(3 * i + c));
      Lanes row;
      for (int column = 0; column < columns; ++column) row[column] = rows(3 * i + c, column);
      several.apply(i, c, row);
      for (int column = 0; column < columns; ++column) found(3 * i + c, column) = row[column];
    }
  EXPECT_LT((found - expected).norm(), 1e-8 * expected.norm());
  EXPECT_LT((alone - expected.col(3)).norm(), 1e-8 * expected.col(3).norm());
}

TEST(Whitening, DividesByTheNoiseWithoutDisturbance) {
  const std::vector<double> times = unevenTimes(5);
  const Vector3<double> noise(1, 2, 4);
  const Whitening<double> whitening = driftingErrors(times, 1, 3, noise, Vector3<double>::Zero());
  ASSERT_EQ(whitening.over_deviation.size(), 3u);
  Innovations<double, double> innovations(whitening);
  for (int i = 0; i < 3; ++i)
    for (int c = 0; c < 3; ++c) {
      double error = 1;
      innovations.apply(i, c, error);
      EXPECT_DOUBLE_EQ(error, 1 / noise(c));
    }
}

}  // namespace
}  // namespace ground

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
