// The missing wrench of a model from noisy poses, and predictions from a measured state.
#include "ground/identification/inferred_wrench.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "ground/control/prbs.h"
#include "ground/identification/prediction.h"
#include "ground/model/effect_registry.h"
#include "ground/model/model_file.h"

namespace ground {
namespace {

constexpr double kPositionNoise = 3e-4, kHeadingNoise = 5e-3;

Model nominal() { return loadModel("cfg/hovercraft/tiny_whoover.yaml"); }

Model with(const std::string& effects) {
  const std::string text = formatModel(nominal());
  return parseModel(text.substr(0, text.find("effects:")) + "effects:\n" + effects, "test");
}

/// A run with the true motion, along which the filter linearises, and noisy poses.
RunData record(const Model& model, double noise, unsigned seed = 1, double duration = 12) {
  RunData run;
  run.name = "artificial";
  PrbsParams params;
  params.clock = 15;
  params.duration = duration;
  const PrbsSignal prbs(makePrbs(9, seed), params);
  for (double t = 0; t < duration; t = prbs.nextChange(t))
    run.inputs.add(t, prbs.at(t).x(), prbs.at(t).y(), 1);
  const Dynamics<double> dynamics(model);
  Simulation<double> simulation(dynamics, run.inputs, {}, 0);
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform(0.6, 1.4);
  const int count = static_cast<int>(duration * 100);
  run.eta.resize(count, 3);
  run.nu.resize(count, 3);
  run.poses.resize(count, 3);
  double t = 0;
  for (int i = 0; i < count; ++i) {
    simulation.advance(t);
    run.times.push_back(t);
    run.eta.row(i) = simulation.measure().eta;
    run.nu.row(i) = simulation.measure().nu;
    const Vector3<double> sigma(kPositionNoise, kPositionNoise, kHeadingNoise);
    for (int c = 0; c < 3; ++c) run.poses(i, c) = run.eta(i, c) + noise * sigma(c) * normal(random);
    run.poses(i, 2) = wrapAngle(run.poses(i, 2));
    t += 0.01 * uniform(random);  // stamps are not uniform
  }
  return run;
}

/// Share of samples in which the inferred wrench is within two standard deviations of the truth.
double covered(const InferredWrench& inferred, const Eigen::MatrixX3d& truth, int channel) {
  const auto off = (inferred.wrench.col(channel) - truth.col(channel)).cwiseAbs();
  return (off.array() < 2 * inferred.sigma.col(channel).array()).cast<double>().mean();
}

TEST(Prediction, FollowsTheModelFromAMeasuredState) {
  for (const char* effects : {"  - {name: motor_lag, tau: 0.05}\n",
                              "  - {name: heading_offset, psi0: 3.0}\n"
                              "  - {name: marker_offset, dx: 0.02, dy: -0.01}\n"}) {
    const Model model = with(effects);
    const RunData recorded = record(model, 0);
    const std::vector<Window> windows = {{0, 100, 500}, {0, 300, 301}};
    Eigen::MatrixX3d nu(2, 3);
    for (int w = 0; w < 2; ++w) nu.row(w) = recorded.nu.row(windows[w].first);
    const WindowSimulation found = predict(model, recorded, windows, nu);
    for (int w = 0; w < 2; ++w) {
      const int rows = windows[w].last - windows[w].first + 1;
      const Eigen::MatrixXd eta = recorded.eta.middleRows(windows[w].first, rows);
      EXPECT_LT((found.eta[w] - eta).cwiseAbs().maxCoeff(), 1e-6) << effects;
    }
  }
  const RunData recorded = record(nominal(), 0, 1, 1);
  EXPECT_THROW(predict(nominal(), recorded, {{0, 50, 100}}, Eigen::MatrixX3d::Zero(1, 3)),
               std::invalid_argument);
  EXPECT_THROW(predict(nominal(), recorded, {{0, 0, 10}}, Eigen::MatrixX3d::Zero(2, 3)),
               std::invalid_argument);
}

TEST(InferredWrench, IsZeroWithTheTrueModel) {
  const RunData recorded = record(nominal(), 1);
  const WrenchFilter filter(nominal(), recorded);
  const WrenchNoise noise = filter.likeliestNoise(WrenchNature::kRandomWalk);
  EXPECT_NEAR(noise.position, kPositionNoise, 0.2 * kPositionNoise);
  EXPECT_NEAR(noise.heading, kHeadingNoise, 0.2 * kHeadingNoise);
  const InferredWrench inferred = filter.smooth(noise);
  EXPECT_LT(inferred.wrench.leftCols<2>().cwiseAbs().maxCoeff(), 1e-3);
  EXPECT_LT(inferred.wrench.col(2).cwiseAbs().maxCoeff(), 3e-5);
}

TEST(InferredWrench, InnovationsOfTheTrueModelAreWhiteWithUnitVariance) {
  // Forces that depend on the place need the second pass of derivatives.
  const std::string tilt =
      "  - name: bowl\n"
      "    expression: {X: \"-c*(x*cos(psi)+y*sin(psi))\", Y: \"c*(x*sin(psi)-y*cos(psi))\"}\n"
      "    parameters:\n      c: {value: 0.05, unit: N/m, lower: 0, upper: 1}\n";
  for (const Model& model : {nominal(), with(tilt)}) {
    const RunData recorded = record(model, 1, 2);
    const WrenchFilter filter(model, recorded);
    const WrenchNoise noise = filter.likeliestNoise(WrenchNature::kWhite);
    const Innovations found = filter.innovations(WrenchNature::kWhite, noise);
    const int count = static_cast<int>(recorded.times.size());
    for (int c = 0; c < 3; ++c) {
      double square = 0, product = 0;
      int n = 0;
      for (int i = 1; i < count; ++i) {
        if (!found.valid[i] || !found.valid[i - 1]) continue;
        square += std::pow(found.normalised(i, c), 2);
        product += found.normalised(i, c) * found.normalised(i - 1, c);
        ++n;
      }
      EXPECT_NEAR(square / n, 1, 0.25) << "channel " << c;
      EXPECT_LT(std::abs(product / square), 3 / std::sqrt(n)) << "channel " << c;
    }
  }
}

TEST(InferredWrench, FindsAConstantWrench) {
  const Model truth = with(
      "  - {name: body_force_bias, x0: 0.01, y0: -0.02}\n"
      "  - {name: yaw_bias, n0: 2.0e-4}\n");
  const RunData recorded = record(truth, 1);
  const WrenchFilter filter(nominal(), recorded);
  const InferredWrench inferred = filter.smooth(filter.likeliestNoise(WrenchNature::kRandomWalk));
  const Vector3<double> wrench(0.01, -0.02, 2e-4);
  for (int c = 0; c < 3; ++c)
    EXPECT_NEAR(inferred.wrench.col(c).mean(), wrench(c), 0.1 * std::abs(wrench(c)))
        << "channel " << c;
}

TEST(InferredWrench, FollowsAVaryingWrench) {
  const Model truth = with(
      "  - name: swell\n"
      "    expression: {X: \"a*sin(3*t)\", Y: \"a*cos(2*t)\", N: \"0.01*a*sin(4*t)\"}\n"
      "    parameters:\n      a: {value: 0.02, unit: N, lower: 0, upper: 1}\n");
  const RunData recorded = record(truth, 1, 3);
  const WrenchFilter filter(nominal(), recorded);
  const InferredWrench inferred = filter.smooth(filter.likeliestNoise(WrenchNature::kRandomWalk));
  const auto count = static_cast<Eigen::Index>(recorded.times.size());
  Eigen::MatrixX3d wrench(count, 3);
  for (Eigen::Index i = 0; i < count; ++i) {
    const double t = recorded.times[i];
    wrench.row(i) << 0.02 * std::sin(3 * t), 0.02 * std::cos(2 * t), 2e-4 * std::sin(4 * t);
  }
  const Vector3<double> size(0.02, 0.02, 2e-4);
  for (int c = 0; c < 3; ++c) {
    const double rms = std::sqrt((inferred.wrench.col(c) - wrench.col(c)).squaredNorm() / count);
    EXPECT_LT(rms, 0.25 * size(c)) << "channel " << c;
    const double share = covered(inferred, wrench, c);
    EXPECT_GT(share, 0.85) << "channel " << c;
  }
}

TEST(InferredWrench, RespondsToAnActingWrenchAsPredicted) {
  // The force changes faster than the smoother can follow.
  const Model truth = with(
      "  - name: buzz\n"
      "    expression: {Y: \"a*(sin(12*t) > 0 ? 1 : -1)\"}\n"
      "    parameters:\n      a: {value: 0.01, unit: N, lower: 0, upper: 1}\n");
  const RunData with_force = record(truth, 0);
  const WrenchFilter filter(nominal(), with_force);
  const auto count = static_cast<Eigen::Index>(with_force.times.size());
  Eigen::MatrixXd acting(count, 1);
  for (Eigen::Index i = 0; i < count; ++i)
    acting(i) = std::sin(12 * with_force.times[i]) > 0 ? 0.01 : -0.01;
  WrenchNoise noise;
  noise.force = 0.005;
  noise.moment = 1e-3;
  noise.position = kPositionNoise;
  noise.heading = kHeadingNoise;
  const InferredWrench inferred = filter.smooth(noise, acting, {1});
  const Eigen::VectorXd found = inferred.wrench.col(1), predicted = inferred.responses.col(0);
  EXPECT_LT((found - predicted).norm(), 0.1 * found.norm());
  // The smoother attenuates the force.
  EXPECT_LT(found.norm(), 0.8 * acting.norm());
  EXPECT_GT(found.norm(), 0.2 * acting.norm());
}

TEST(InferredWrench, RestartsAfterAGap) {
  RunData recorded = record(nominal(), 1);
  for (std::size_t i = 600; i < recorded.times.size(); ++i) recorded.times[i] += 0.5;
  const WrenchFilter filter(nominal(), recorded);
  EXPECT_EQ(filter.stretches(), (std::vector<int>{0, 600, 1200}));
  const auto noise = filter.likeliestNoise(WrenchNature::kRandomWalk);
  EXPECT_TRUE(filter.smooth(noise).wrench.allFinite());
  const Innovations found = filter.innovations(WrenchNature::kRandomWalk, noise);
  EXPECT_FALSE(found.valid[600]);
  EXPECT_TRUE(found.valid[599]);
}

TEST(InferredWrench, GivesTheModelsThrust) {
  const RunData recorded = record(nominal(), 0, 1, 2);
  const double k = nominal().body.k, l = nominal().body.l;
  const auto thrustOf = [&](const Model& model) {
    return WrenchFilter(model, recorded).modelThrust();
  };
  const Eigen::MatrixX3d plain = thrustOf(nominal());
  const Eigen::MatrixX3d turned =
      thrustOf(with("  - {name: thrust_misalignment, angle: 1.5707963267948966}\n"
                    "  - {name: added_mass, mx: 0.01, my: 0.03}\n"));
  for (Eigen::Index i = 0; i < plain.rows(); ++i) {
    const auto& times = recorded.inputs.times;
    const auto at = std::upper_bound(times.begin(), times.end(), recorded.times[i]);
    const Vector2<double> u = recorded.inputs.thrusters[at - times.begin() - 1];
    EXPECT_NEAR(plain(i, 0), k * u.sum(), 1e-9);
    EXPECT_NEAR(plain(i, 1), 0, 1e-9);
    EXPECT_NEAR(plain(i, 2), k * l * (u(0) - u(1)), 1e-9);
    EXPECT_NEAR(turned(i, 0), 0, 1e-9);
    EXPECT_NEAR(turned(i, 1), k * u.sum(), 1e-9);
  }
}

TEST(InferredWrench, RefusesBadArguments) {
  RunData recorded = record(nominal(), 1, 1, 1);
  RunData bad = recorded;
  bad.poses(3, 1) = std::nan("");
  EXPECT_THROW(WrenchFilter(nominal(), bad), std::invalid_argument);
  bad.poses = recorded.poses.topRows(5);
  EXPECT_THROW(WrenchFilter(nominal(), bad), std::invalid_argument);
  const WrenchFilter filter(nominal(), recorded);
  const WrenchNoise noise = filter.likeliestNoise(WrenchNature::kRandomWalk);
  EXPECT_THROW(filter.smooth(noise, Eigen::MatrixXd::Zero(100, 1), {3}), std::invalid_argument);
  EXPECT_THROW(filter.smooth(noise, Eigen::MatrixXd::Zero(99, 1), {0}), std::invalid_argument);
  std::swap(recorded.times[10], recorded.times[11]);
  EXPECT_THROW(WrenchFilter(nominal(), recorded), std::invalid_argument);
}

}  // namespace
}  // namespace ground

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
