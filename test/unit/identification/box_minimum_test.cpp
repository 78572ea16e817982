// The minimum of a quadratic function in a box.
#include "ground/control/box_minimum.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <random>

namespace ground {
namespace box_minimum_test {

std::mt19937 random_numbers(5);

double uniform(double low, double high) {
  return std::uniform_real_distribution<double>(low, high)(random_numbers);
}

/// Solves random problems of `size` and checks the conditions of Karush, Kuhn and Tucker, which are
/// sufficient because the function is convex. Returns the number of elements at a bound.
int boundsOfRandomProblems(int size, int problems) {
  int at_bounds = 0;
  for (int problem = 0; problem < problems; ++problem) {
    SCOPED_TRACE(testing::Message() << size << " elements, problem " << problem);
    const Eigen::MatrixXd root = Eigen::MatrixXd::NullaryExpr(size, size, [] { return uniform(-1, 1); });
    const BoxMinimum::Square H =
        root * root.transpose() + uniform(1e-3, 0.3) * Eigen::MatrixXd::Identity(size, size);
    PerThruster g = PerThruster::Zero(size), low = g, high = g;
    for (int i = 0; i < size; ++i) {
      g(i) = uniform(-2, 2);
      low(i) = -uniform(0, 1) * (problem % 3 == 0 ? 10 : 1);
      high(i) = problem % 5 == 0 && i == 0 ? low(i) : low(i) + uniform(0, 2);
    }
    BoxMinimum box;
    EXPECT_TRUE(box.solve(H, g, low, high));
    const PerThruster d = box.minimum(), slope = g + H * d;
    EXPECT_LT((box.unbounded() + H.inverse() * g).norm(), 1e-8 * (1 + box.unbounded().norm()));
    Eigen::MatrixXd inside = H;
    for (int i = 0; i < size; ++i) {
      EXPECT_GE(d(i), low(i));
      EXPECT_LE(d(i), high(i));
      if (box.free()(i)) {
        EXPECT_NEAR(slope(i), 0, 1e-9);
        continue;
      }
      ++at_bounds;
      EXPECT_TRUE(d(i) == low(i) || d(i) == high(i));
      if (d(i) < high(i)) {
        EXPECT_GT(slope(i), -1e-9);
      }
      if (d(i) > low(i)) {
        EXPECT_LT(slope(i), 1e-9);
      }
      inside.row(i).setZero();
      inside.col(i).setZero();
      inside(i, i) = 1;
    }
    // Equations of the free elements.
    const Eigen::MatrixXd sides = Eigen::MatrixXd::NullaryExpr(3, size, [] { return uniform(-1, 1); });
    Eigen::MatrixXd wanted = sides;
    for (int i = 0; i < size; ++i)
      if (!box.free()(i)) wanted.col(i).setZero();
    wanted = wanted * inside.inverse();
    EXPECT_LT((box.solveFree(sides) - wanted).norm(), 1e-8 * (1 + wanted.norm()));
  }
  return at_bounds;
}

TEST(BoxMinimum, MeetsTheConditionsOfAMinimum) {
  for (int size = 1; size <= kMaxThrusters; ++size)
    EXPECT_GT(boundsOfRandomProblems(size, 200), 40 * size) << size;
}

TEST(BoxMinimum, AFunctionWithoutMinimumIsRefused) {
  const Eigen::Vector2d g(0.1, 0.2), low(-1, -1), high(1, 1);
  for (const Eigen::Vector2d& diagonal :
       {Eigen::Vector2d(-1, 1), Eigen::Vector2d(1, -1), Eigen::Vector2d(-1, -2), Eigen::Vector2d(0, 1)}) {
    const Eigen::Matrix2d H = diagonal.asDiagonal();
    EXPECT_FALSE(BoxMinimum().solve(H, g, low, high)) << diagonal.transpose();
  }
  Eigen::Matrix2d coupled;
  coupled << 1, 1.1, 1.1, 1;
  EXPECT_FALSE(BoxMinimum().solve(coupled, g, low, high));
}

}  // namespace box_minimum_test
}  // namespace ground
