#include "ground/estimation/smoother.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

namespace ground {
namespace {

constexpr double kNoise = 3e-4;  // [m]

/// 20 s of a smooth way, measured at 100 Hz, that steps by so many metres in the middle.
struct Way {
  explicit Way(double step) : positions(2000) {
    std::mt19937 engine(1);
    std::normal_distribution<double> noise(0.0, kNoise);
    for (int k = 0; k < 2000; ++k) {
      stamps.push_back(0.01 * k);
      positions(k) = 0.5 * std::sin(1.3 * 0.01 * k) + noise(engine) + (k < 1000 ? 0.0 : step);
    }
  }
  std::vector<double> stamps;
  Eigen::VectorXd positions;
};

double likeliestJerk(const Way& way) {
  double best = 0, most = -1e300;
  for (double jerk = 1e-3; jerk < 1e5; jerk *= 1.5)
    if (const double one = motionLikelihood(way.stamps, way.positions, kNoise, jerk, 0.1, 0.7); one > most) {
      most = one;
      best = jerk;
    }
  return best;
}

TEST(Smoother, AStepOfThePoseIsNotTakenForMotion) {
  EXPECT_NEAR(std::log(likeliestJerk(Way(2.0)) / likeliestJerk(Way(0.0))), 0.0, std::log(1.6));
}

TEST(Smoother, NoPoseLeadsToASpeedBeyondTheLargest) {
  // Stamps of a network that delivers every tenth second at once: the order is right, the instants are not.
  std::vector<double> stamps;
  Eigen::MatrixX3d eta = Eigen::MatrixX3d::Zero(600, 3);
  for (int k = 0; k < 600; ++k) {
    stamps.push_back(0.1 * std::floor(k / 10.0) + 1e-5 * (k % 10));
    eta(k, 0) = 0.008 * k;
    eta(k, 2) = 0.1 * k;
  }
  EstimatorParams params;
  params.linear_jerk = params.angular_jerk = 1e6;  // believes any motion
  params.linear_speed = 0.8;
  params.angular_speed = 10;
  params.most = 2;
  const SmoothedMotion motion = smooth(stamps, eta, params);
  for (Eigen::Index k = 0; k < 600; ++k) {
    if (motion.used[static_cast<std::size_t>(k)]) {
      EXPECT_LT(std::abs(motion.nu(k, 2)), 3 * 10.0) << k;
    }
  }
}

}  // namespace
}  // namespace ground
