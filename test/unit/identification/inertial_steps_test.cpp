// What a gyro and an accelerometer add to the disturbance filter.
#include "../../../src/ground/src/identification/inertial_steps.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

#include "../../../src/ground/src/identification/disturbance_filter.h"
#include "../disturbed_run.h"

namespace ground::detail {
namespace inertial_steps_test {

constexpr double kCap = std::numeric_limits<double>::infinity();

/// Samples in the middle between poses, as a sensor at `place` would measure the true motion.
InertialData sensed(const RunData& run, const Vector2<double>& place, unsigned seed) {
  InertialData data;
  data.place = place;
  data.noise = {2e-3, 0.05, 0.05};
  data.values.resize(run.nu.rows() - 1, 3);
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  for (Eigen::Index i = 0; i + 1 < run.nu.rows(); ++i) {
    const auto at = static_cast<std::size_t>(i);
    const double dt = run.times[at + 1] - run.times[at];
    data.times.push_back(run.times[at] + 0.5 * dt);
    const Measurement<double> from{run.eta.row(i).transpose(), run.nu.row(i).transpose()};
    const Measurement<double> to{run.eta.row(i + 1).transpose(), run.nu.row(i + 1).transpose()};
    data.values.row(i) = inertialBetween(from, to, dt, place);
    for (int c = 0; c < 3; ++c) data.values(i, c) += data.noise(c) * normal(random);
  }
  return data;
}

class Sensed : public testing::Test {
 protected:
  Sensed() {
    run_.inertial = sensed(run_, {0.02, -0.01}, 5);
    levels_.sigma = pushes(model_, 0.05).sigma;
    levels_.trim = 0.5 * levels_.sigma;
  }

  const Model model_ = craft();
  RunData run_ = disturbedRun(model_, pushes(model_, 0.05), 3);
  DisturbanceLevels levels_ = LevelPrior(model_.body).median;
};

TEST_F(Sensed, StepsHaveMeansOfTheSamplesInThem) {
  RunData run = run_;
  InertialData line;
  for (int i = 0; i < 300; ++i) line.times.push_back(0.01 * i);
  line.values.resize(300, 3);
  for (Eigen::Index i = 0; i < 300; ++i) line.values.row(i) << 0.02 * i, 1, 0;
  run.inertial = line;
  const InertialSteps steps(run);
  ASSERT_FALSE(steps.has(0));
  ASSERT_TRUE(steps.has(5));
  EXPECT_NEAR(steps.mean(5, 0), run.times[4] + run.times[5], 1e-12);
  EXPECT_NEAR(steps.mean(5, 1), 1, 1e-12);
  EXPECT_NEAR(steps.noise(5, 1), line.noise(1) * std::sqrt(0.01 * 120), 1e-9);
  EXPECT_FALSE(steps.has(run.times.size() - 1)) << "samples end before the run does";
}

TEST_F(Sensed, NothingIsInterpolatedOverALongPauseOfTheSensor) {
  InertialData& data = run_.inertial;
  const Eigen::Index kept = 200, lost = 10;
  data.times.erase(data.times.begin() + kept, data.times.begin() + kept + lost);
  Eigen::MatrixX3d values(data.values.rows() - lost, 3);
  values << data.values.topRows(kept), data.values.bottomRows(data.values.rows() - kept - lost);
  data.values = values;
  const InertialSteps steps(run_);
  EXPECT_TRUE(steps.has(199));
  EXPECT_FALSE(steps.has(205));
  EXPECT_TRUE(steps.has(213));
}

TEST_F(Sensed, LevelScoresAreThoseOfFiniteDifferences) {
  DisturbanceFilter filter(run_);
  ASSERT_TRUE(std::isfinite(filter.run(model_, levels_, kCap)));
  const RunLevelScores found = filter.levelScores(levels_);
  for (int i = 0; i < kLevels; ++i) {
    constexpr double kChange = 1e-3;
    auto up = levels_.values(), down = up;
    up[static_cast<std::size_t>(i)] *= std::exp(kChange);
    down[static_cast<std::size_t>(i)] *= std::exp(-kChange);
    DisturbanceFilter other(run_);
    const double above = other.run(model_, DisturbanceLevels::of(up), kCap);
    const double below = other.run(model_, DisturbanceLevels::of(down), kCap);
    const double slope = (above - below) / (2 * kChange);
    // Changed levels change the linearisation, too, which the score leaves out.
    EXPECT_NEAR(found.score(i), slope, 0.03 * std::abs(slope) + 0.05 * std::sqrt(found.information(i, i)))
        << DisturbanceLevels::names()[static_cast<std::size_t>(i)];
  }
}

TEST_F(Sensed, ResponsesAreWhatAKnownWrenchChanges) {
  const auto count = static_cast<Eigen::Index>(run_.times.size());
  Eigen::MatrixX3d wrench(count, 3);
  const Vector3<double> size = levels_.sigma;
  for (Eigen::Index k = 0; k < count; ++k)
    wrench.row(k) = 0.01 * std::sin(0.05 * static_cast<double>(k)) * size.transpose();
  DisturbanceFilter filter(run_);
  ASSERT_TRUE(std::isfinite(filter.run(model_, levels_, kCap)));
  RunData known = run_;
  known.wrench = wrench;
  DisturbanceFilter explained(known);
  ASSERT_TRUE(std::isfinite(explained.run(model_, levels_, kCap)));
  const Eigen::MatrixXd change = filter.whitened() - explained.whitened();
  const Eigen::MatrixXd response = filter.responses(wrench);
  ASSERT_EQ(change.cols(), 6);
  double error = 0, whole = 0;
  for (Eigen::Index k = 1; k < count; ++k)
    for (Eigen::Index c = 0; c < 6; ++c) {
      error += std::pow(change(k, c) - response(6 * k + c, 0), 2);
      whole += std::pow(change(k, c), 2);
    }
  EXPECT_LT(error, 0.01 * whole);
}

TEST_F(Sensed, TheSmoothedWrenchIsNearerToTheTruthAndAsCertainAsItSays) {
  RunData blind = run_;
  blind.inertial = {};
  const SmoothedWrench with = DisturbanceFilter(run_).smooth(model_, levels_, kCap);
  const SmoothedWrench without = DisturbanceFilter(blind).smooth(model_, levels_, kCap);
  EXPECT_LT(with.sigma.col(2).mean(), 0.8 * without.sigma.col(2).mean());
  // Both estimate one wrench: they differ by no more than the worse one may be off.
  const Eigen::ArrayX3d away = (with.wrench - without.wrench).array() / without.sigma.array();
  EXPECT_LT(std::sqrt(away.square().mean()), 1.5);
}

TEST_F(Sensed, InnovationsOfTheTrueModelAreWhite) {
  DisturbanceFilter filter(run_);
  ASSERT_TRUE(std::isfinite(filter.run(model_, levels_, kCap)));
  const Eigen::MatrixXd rows = filter.whitened().bottomRows(800);
  for (Eigen::Index c = 0; c < 6; ++c) {
    EXPECT_LT(rows.col(c).squaredNorm() / 800, 1.4) << c;
    // Samples at the rate of the poses are interpolated, which averages two of them.
    EXPECT_GT(rows.col(c).squaredNorm() / 800, 0.2) << c;
  }
}

}  // namespace inertial_steps_test
}  // namespace ground::detail
