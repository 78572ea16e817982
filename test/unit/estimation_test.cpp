// From poses to velocities: frames, filters, and everything that mocap does wrong.
#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <random>

#include "ground/control/prbs.h"
#include "ground/estimation/axis_mapping.h"
#include "ground/estimation/smoother.h"
#include "ground/estimation/velocity_estimator.h"
#include "ground/model/model_file.h"
#include "ground/model/simulation.h"

namespace ground {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;

TEST(AxisMapping, GoesRoundInEveryFrame) {
  for (const char* axes : {"x, z, -y", "x,y,z", "-y,x,z", "x,-y,-z", "z, x, y", "+y, -x, +z"}) {
    const AxisMapping mapping(axes, 0.3);
    for (double psi = -3.1; psi < 3.1; psi += 0.37) {
      Vector3d p;
      Quaterniond q;
      mapping.toMocap({1.5, -0.7, psi}, 0.04, p, q);
      const auto back = mapping.toPlanar(p, q);
      ASSERT_TRUE(back) << axes;
      EXPECT_LT((*back - Vector3<double>(1.5, -0.7, psi)).norm(), 1e-12) << axes;
    }
  }
}

TEST(AxisMapping, OptiTrackFollowsTheThesis) {
  const AxisMapping mapping;
  // OptiTrack: y up. Turning clockwise seen from above is a negative rotation about y.
  const Quaterniond clockwise(Eigen::AngleAxisd(-0.4, Vector3d::UnitY()));
  const auto eta = mapping.toPlanar({1, 0.04, 2}, clockwise);
  ASSERT_TRUE(eta);
  EXPECT_NEAR(eta->x(), 1, 1e-12);
  EXPECT_NEAR(eta->y(), 2, 1e-12);
  EXPECT_NEAR(eta->z(), 0.4, 1e-12);
  Vector3d p;
  Quaterniond q;
  mapping.toMocap({1, 2, 0.4}, 0.04, p, q);
  EXPECT_LT((p - Vector3d(1, 0.04, 2)).norm(), 1e-12);
  EXPECT_LT(q.angularDistance(clockwise), 1e-12);
}

TEST(AxisMapping, SubtractsTheHeadingOffset) {
  const auto eta = AxisMapping("x,y,z", 0.5)
                       .toPlanar({0, 0, 0}, Quaterniond(Eigen::AngleAxisd(0.7, Vector3d::UnitZ())));
  EXPECT_NEAR(eta->z(), 0.2, 1e-12);
}

TEST(AxisMapping, RefusesWhatIsNoFrameAndNoPose) {
  for (const char* axes : {"", "x", "x,y", "x,y,w", "x,x,z", "y,x,z", "x,y,z,x", "x;y;z", "xx,y,z"})
    EXPECT_THROW(AxisMapping mapping(axes), std::invalid_argument) << axes;
  const AxisMapping mapping;
  EXPECT_FALSE(mapping.toPlanar({NAN, 0, 0}, Quaterniond::Identity()));
  EXPECT_FALSE(mapping.toPlanar({0, 0, 0}, Quaterniond(0, 0, 0, 0)));
  EXPECT_FALSE(mapping.toPlanar({0, 0, 0}, Quaterniond(NAN, 0, 0, 0)));
  EXPECT_FALSE(mapping.toPlanar({0, 0, 0}, Quaterniond(Eigen::AngleAxisd(3, Vector3d::UnitX()))));
}

struct Motion {
  std::vector<double> times;
  std::vector<Vector3<double>> eta, nu, measured;
};

/// The Tiny Whoover driven by a 15 Hz PRBS, seen at 100 Hz with 0.5 mm and 0.3 degrees of noise.
Motion experiment(unsigned seed, double duration = 20) {
  const Model model = loadModel("cfg/hovercraft/tiny_whoover.yaml");
  const Dynamics<double> dynamics(model);
  PrbsParams params;
  params.duration = duration;
  const PrbsSignal prbs(makePrbs(9, seed), params);
  InputSequence inputs;
  for (double t = 0; t < duration; t = prbs.nextChange(t))
    inputs.add(t, prbs.at(t).x(), prbs.at(t).y(), 1);
  Simulation<double> simulation(dynamics, inputs, {}, 0);
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  Motion motion;
  for (double t = 0; t < duration; t += 0.01) {
    simulation.advance(t);
    motion.times.push_back(t);
    motion.eta.push_back(simulation.state().eta);
    motion.nu.push_back(simulation.state().nu);
    Vector3<double> measured = simulation.state().eta;
    measured +=
        Vector3<double>(5e-4 * normal(random), 5e-4 * normal(random), 5.236e-3 * normal(random));
    measured.z() = wrapAngle(measured.z());
    motion.measured.push_back(measured);
  }
  return motion;
}

using Factory = std::unique_ptr<VelocityEstimator> (*)(const EstimatorParams&);

struct Quality {
  Vector3<double> rms, delay;
};

/// RMS error, and the delay [s] by which the true velocity matches the estimate best.
Quality judge(const Motion& motion, const std::vector<Vector3<double>>& estimates,
              const std::vector<int>& at) {
  Quality quality;
  const auto error = [&](int channel, double delay) {
    double sum = 0;
    int count = 0;
    for (std::size_t k = 50; k < at.size(); ++k) {
      const double where = at[k] - delay / 0.01;
      const int i = static_cast<int>(std::floor(where));
      if (i < 0 || i + 1 >= static_cast<int>(motion.nu.size())) continue;
      const double w = where - i;
      const double truth = (1 - w) * motion.nu[i](channel) + w * motion.nu[i + 1](channel);
      sum += std::pow(estimates[k](channel) - truth, 2);
      ++count;
    }
    return std::sqrt(sum / count);
  };
  for (int c = 0; c < 3; ++c) {
    quality.rms(c) = error(c, 0);
    double best = 1e9;
    for (double delay = -0.01; delay < 0.1; delay += 5e-4) {
      if (error(c, delay) >= best) continue;
      best = error(c, delay);
      quality.delay(c) = delay;
    }
  }
  return quality;
}

Quality run(Factory make, const Motion& motion, bool faults) {
  const auto estimator = make(EstimatorParams());
  std::mt19937 random(5);
  std::uniform_real_distribution<double> uniform;
  std::vector<Vector3<double>> estimates;
  std::vector<int> at;
  for (std::size_t i = 0; i < motion.times.size(); ++i) {
    if (faults && motion.times[i] > 8 && motion.times[i] < 8.2) continue;
    estimator->update(motion.times[i], motion.measured[i]);
    if (faults && uniform(random) < 0.05) estimator->update(motion.times[i], motion.measured[i]);
    const StateEstimate& e = estimator->estimate();
    if (!e.valid) continue;
    estimates.push_back(e.nu);
    at.push_back(static_cast<int>(i));
  }
  EXPECT_GT(at.size(), 0.95 * motion.times.size());
  return judge(motion, estimates, at);
}

TEST(VelocityEstimator, ErrorAndDelayAreAsStated) {
  const Motion motion = experiment(1);
  std::printf("%-20s %-30s %s\n", "", "RMS u, v [m/s], r [rad/s]", "delay u, v, r [ms]");
  const auto show = [](const char* name, const Quality& q) {
    std::printf("%-20s %.4f  %.4f  %.3f %12s %5.1f %5.1f %5.1f\n", name, q.rms(0), q.rms(1),
                q.rms(2), "", 1e3 * q.delay(0), 1e3 * q.delay(1), 1e3 * q.delay(2));
  };
  const Quality kalman = run(makeKalmanEstimator, motion, false);
  const Quality differences = run(makeFiniteDifferenceEstimator, motion, false);
  const Quality kalman_faults = run(makeKalmanEstimator, motion, true);
  const Quality differences_faults = run(makeFiniteDifferenceEstimator, motion, true);
  show("Kalman", kalman);
  show("differences", differences);
  show("Kalman, faults", kalman_faults);
  show("differences, faults", differences_faults);

  Eigen::MatrixX3d eta(motion.times.size(), 3);
  std::vector<int> at;
  for (std::size_t i = 0; i < motion.times.size(); ++i) {
    eta.row(i) = motion.measured[i];
    at.push_back(static_cast<int>(i));
  }
  const SmoothedMotion smoothed = smooth(motion.times, eta, EstimatorParams());
  std::vector<Vector3<double>> rows;
  for (Eigen::Index i = 0; i < smoothed.nu.rows(); ++i) rows.push_back(smoothed.nu.row(i));
  const Quality offline = judge(motion, rows, at);
  show("smoother", offline);

  for (int c = 0; c < 3; ++c) {
    EXPECT_LT(kalman.rms(c), Vector3<double>(0.05, 0.05, 0.6)(c));
    EXPECT_LT(kalman.delay(c), 0.025);
    EXPECT_LT(kalman.rms(c), differences.rms(c)) << "the default has to be the better one";
    EXPECT_LT(differences.rms(c), Vector3<double>(0.12, 0.12, 0.9)(c));
    EXPECT_LT(differences.delay(c), 0.04);
    EXPECT_LT(kalman_faults.rms(c), 1.6 * kalman.rms(c)) << "gap and duplicates do no harm";
    EXPECT_LT(differences_faults.rms(c), 1.6 * differences.rms(c));
    EXPECT_LT(offline.rms(c), 0.5 * kalman.rms(c));
    EXPECT_LT(std::abs(offline.delay(c)), 2e-3);
  }
}

class Either : public testing::TestWithParam<Factory> {
 protected:
  /// Uniform motion: 1 m/s along x, turning at 2 rad/s.
  static Vector3<double> pose(double t) { return {t, 0.5, wrapAngle(2 * t)}; }
  /// Feeds two seconds of it.
  void settle() {
    for (double t = 0; t < 2; t += 0.01) estimator->update(t, pose(t));
  }
  std::unique_ptr<VelocityEstimator> estimator = GetParam()(EstimatorParams());
};

TEST_P(Either, GivesBodyVelocitiesAndUnwrapsTheHeading) {
  for (double t = 0; t < 10; t += 0.01) {
    const StateEstimate& e = estimator->update(t, pose(t));
    if (t < 1) continue;
    ASSERT_TRUE(e.valid);
    EXPECT_NEAR(e.nu.x(), std::cos(2 * t), 0.06);
    EXPECT_NEAR(e.nu.y(), -std::sin(2 * t), 0.06);
    EXPECT_NEAR(e.nu.z(), 2, 0.02);
    EXPECT_NEAR(e.eta.z(), 2 * t, 0.01);
    // constant in the world, turning in the body: u' = r v, v' = -r u
    EXPECT_NEAR(e.nu_dot.x(), 2 * e.nu.y(), 0.3);
    EXPECT_NEAR(e.nu_dot.y(), -2 * e.nu.x(), 0.3);
  }
}

TEST_P(Either, IsNotValidBeforeItHasSettled) {
  EXPECT_FALSE(estimator->update(0, pose(0)).valid);
  EXPECT_FALSE(estimator->update(0.01, pose(0.01)).valid);
  settle();
  EXPECT_TRUE(estimator->estimate().valid);
}

TEST_P(Either, IgnoresRepeatedAndLatePoses) {
  settle();
  const StateEstimate before = estimator->estimate();
  EXPECT_FALSE(estimator->update(1.99, pose(1.99)).used);
  EXPECT_FALSE(estimator->update(1.95, pose(1.95)).used);
  EXPECT_TRUE(estimator->estimate().valid);
  EXPECT_EQ(estimator->estimate().nu, before.nu);
}

TEST_P(Either, SurvivesAGapAndStartsAnewAfterALongOne) {
  settle();
  EXPECT_TRUE(estimator->update(2.19, pose(2.19)).used);
  EXPECT_NEAR(estimator->estimate().nu.z(), 2, 0.05);
  EXPECT_FALSE(estimator->update(4, pose(4)).valid);
  for (double t = 4.01; t < 4.2; t += 0.01) estimator->update(t, pose(t));
  EXPECT_TRUE(estimator->estimate().valid);
  EXPECT_NEAR(estimator->estimate().nu.head<2>().norm(), 1, 0.05);
}

TEST_P(Either, StartsAnewWhenTimeJumpsBack) {
  settle();
  EXPECT_FALSE(estimator->update(-100, pose(0)).valid);
  for (double t = -99.99; t < -99.8; t += 0.01) estimator->update(t, pose(t));
  EXPECT_TRUE(estimator->estimate().valid);
}

TEST_P(Either, IsNotMisledByASpikeOrAFlip) {
  settle();
  double t = 2.0, worst = 0;
  for (int i = 0; i < 30; ++i, t += 0.01) {
    Vector3<double> eta = pose(t);
    if (i == 5) eta.x() += 0.3;
    if (i == 15) eta.z() = -eta.z();
    const StateEstimate& e = estimator->update(t, eta);
    worst = std::max(worst, std::abs(e.nu.z() - 2));
    worst = std::max(worst, std::abs(e.nu.head<2>().norm() - 1));
  }
  EXPECT_LT(worst, 0.2);
}

TEST_P(Either, SaysWhenAPoseIsNotFinite) {
  settle();
  const StateEstimate& e = estimator->update(2.0, {NAN, 0, 0});
  EXPECT_FALSE(e.valid);
  EXPECT_STRNE(e.status, "");
  EXPECT_TRUE(e.nu.allFinite());
  EXPECT_TRUE(estimator->update(2.01, pose(2.01)).valid);
}

INSTANTIATE_TEST_SUITE_P(Estimators, Either,
                         testing::Values(&makeKalmanEstimator, &makeFiniteDifferenceEstimator),
                         [](const auto& info) {
                           return info.index == 0 ? "Kalman" : "FiniteDifferences";
                         });

TEST(KalmanEstimator, FollowsACraftThatWasMovedByHand) {
  const auto estimator = makeKalmanEstimator(EstimatorParams());
  for (double t = 0; t < 1; t += 0.01) estimator->update(t, {0, 0, 0});
  int until_valid = 0;
  for (double t = 1; t < 1.3 && !(estimator->estimate().valid && until_valid > 0); t += 0.01) {
    estimator->update(t, {1, 1, 0});
    ++until_valid;
  }
  EXPECT_LT(until_valid, 15);
  EXPECT_NEAR(estimator->estimate().eta.x(), 1, 1e-3);
}

TEST(KalmanEstimator, ErrorsFitTheirCovariance) {
  const Motion motion = experiment(2);
  const auto estimator = makeKalmanEstimator(EstimatorParams());
  double normalised = 0;
  int count = 0;
  for (std::size_t i = 0; i < motion.times.size(); ++i) {
    const StateEstimate& e = estimator->update(motion.times[i], motion.measured[i]);
    if (i < 100) continue;
    const Vector3<double> error = e.nu - motion.nu[i];
    normalised += error.dot(e.nu_covariance.ldlt().solve(error)) / 3;
    ++count;
  }
  EXPECT_GT(normalised / count, 0.2);
  EXPECT_LT(normalised / count, 3.0);
}

TEST(Smoother, RefusesNonsense) {
  const Eigen::MatrixX3d eta = Eigen::MatrixX3d::Zero(4, 3);
  EXPECT_THROW(smooth({0, 1, 2}, eta, EstimatorParams()), std::invalid_argument);
  EXPECT_THROW(smooth({0, 2, 1, 3}, eta, EstimatorParams()), std::invalid_argument);
  EXPECT_THROW(smooth({0, 1}, Eigen::MatrixX3d::Zero(2, 3), EstimatorParams()),
               std::invalid_argument);
  Eigen::MatrixX3d bad = eta;
  bad(1, 1) = NAN;
  EXPECT_THROW(smooth({0, 1, 2, 3}, bad, EstimatorParams()), std::invalid_argument);
}

}  // namespace
}  // namespace ground

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
