// The search for the maximum of the stochastic likelihood's posterior.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "disturbed_run.h"
#include "ground/model/effect_registry.h"

namespace ground {
namespace {

GreyBoxOptions near(std::vector<std::string> free = kNominal) {
  GreyBoxOptions options = far(std::move(free));
  options.far = false;
  return options;
}

class Ascent : public testing::Test {
 protected:
  const Model truth_ = craft();
  const GreyBox box_{disturbedRuns(truth_, 0.03, 3, 11), truth_.body};
  const GreyBoxFit best_ = box_.fit(box_.start(truth_), far());
};

TEST_F(Ascent, EndsAtTheSameMaximumFromEverywhere) {
  ASSERT_TRUE(best_.converged);
  std::vector<GreyBoxPoint> starts;
  for (std::size_t i = 0; i < DisturbanceLevels::kCount; ++i)
    for (const double factor : {0.05, 20.0}) {
      auto values = best_.point.levels.values();
      if (DisturbanceLevels::names()[i].rfind("white", 0) == 0 && factor < 1) continue;
      values[i] *= factor;
      starts.push_back(best_.point);
      starts.back().levels = DisturbanceLevels::of(values);
    }
  for (const std::string& name : kNominal)
    for (const double factor : {0.6, 1.6}) {
      starts.push_back(best_.point);
      starts.back().model.setValue(name, factor * best_.point.model.value(name));
    }
  for (const double loudness : {-2.0, 2.0}) {
    starts.push_back(best_.point);
    starts.back().loudness = {loudness, 0.0, -loudness};
  }
  for (std::size_t i = 0; i < starts.size(); ++i) {
    const GreyBoxFit fit = box_.fit(starts[i], near());
    EXPECT_TRUE(fit.converged) << i;
    EXPECT_NEAR(fit.log_posterior, best_.log_posterior, 0.1) << i;
    if (getenv("SHOW"))
      printf("%zu %d %g\n", i, fit.iterations, fit.log_posterior - best_.log_posterior);
  }
}

TEST_F(Ascent, ThePosteriorIsTheLikelihoodAndThePriorsOfLevelsAndLoudness) {
  GreyBoxOptions still = near({});
  still.max_iterations = 0;
  GreyBoxPoint point = best_.point;
  // Without given values, the loudness is 0.
  for (const std::vector<double>& loudness :
       {std::vector<double>{}, std::vector<double>{0, 0, 0}, std::vector<double>{0.4, -0.7, 0.1}}) {
    point.loudness = loudness;
    const GreyBoxFit found = box_.fit(point, still);
    const std::vector<Eigen::VectorXd> densities = box_.likelihood(point, still.cap, 1, 1);
    const LevelPrior prior(truth_.body);
    double likelihood = 0, expected = 0;
    for (std::size_t r = 0; r < 3; ++r) {
      EXPECT_NEAR(found.by_run[r], densities[r].sum(), 1e-9 * std::abs(found.by_run[r]));
      likelihood += densities[r].sum();
    }
    for (const double loud : loudness) expected -= 0.5 * std::pow(loud / 0.5, 2);
    for (std::size_t i = 0; i < DisturbanceLevels::kCount; ++i)
      expected -= 0.5 * std::pow(std::log(point.levels.values()[i] / prior.median.values()[i]) /
                                     prior.deviation[i],
                                 2);
    EXPECT_NEAR(found.log_likelihood, likelihood, 1e-9 * std::abs(likelihood));
    EXPECT_NEAR(found.log_posterior - likelihood, expected, 1e-6);
  }
}

TEST(LevelPrior, FavoursNoDirection) {
  const Model model = craft();
  const LevelPrior prior(model.body);
  const double force = typical::force(model.body), moment = typical::moment(model.body);
  const Vector3<double> full(force, force, moment);
  for (const Vector3<double>& median :
       {prior.median.sigma, prior.median.white, prior.median.trim}) {
    const Vector3<double> share = median.cwiseQuotient(full);
    EXPECT_LT((share.array() - share.mean()).abs().maxCoeff(), 1e-12);
  }
  EXPECT_EQ(prior.median.time.maxCoeff(), prior.median.time.minCoeff());
  EXPECT_EQ(prior.median.position, 1);  // the noise that is known of the runs
  EXPECT_EQ(prior.median.heading, 1);
  for (const std::size_t first : {0u, 4u, 8u, 13u})  // sigma, time, white, trim
    for (const std::size_t i : {1u, 2u})
      EXPECT_EQ(prior.deviation[first + i], prior.deviation[first]);
  EXPECT_EQ(prior.deviation[11], prior.deviation[12]);
}

TEST(LevelPrior, IsBroadAboutSmallDisturbancesAndNarrowAboutTheNoise) {
  const Model model = craft();
  const LevelPrior prior(model.body);
  const auto& names = DisturbanceLevels::names();
  const auto median = prior.median.values();
  for (std::size_t i = 0; i < names.size(); ++i) {
    const std::string kind = names[i].substr(0, names[i].find('_'));
    const bool moment = names[i].back() == 'N';
    const double full = moment ? typical::moment(model.body) : typical::force(model.body);
    // Median, and the factor of a standard deviation.
    const bool room = names[i] == "sigma_room" || names[i] == "time_room";
    const auto [expected, factor] = room && kind == "sigma" ? std::make_pair(0.003 * full, 4.5)
                                    : room             ? std::make_pair(1.0, 2.7)
                                    : kind == "sigma"  ? std::make_pair(0.02 * full, 4.5)
                                    : kind == "white"  ? std::make_pair(0.001 * full, 4.5)
                                    : kind == "trim"   ? std::make_pair(0.003 * full, 4.5)
                                    : kind == "time"   ? std::make_pair(0.3, 2.7)
                                    : kind == "thrust" ? std::make_pair(0.01, 2.0)
                                                       : std::make_pair(1.0, 1.5);
    EXPECT_NEAR(median[i] / expected, 1, 1e-9) << names[i];
    EXPECT_NEAR(std::exp(prior.deviation[i]) / factor, 1, 0.02) << names[i];
  }
}

TEST_F(Ascent, NoChangeOfLoudnessRaisesThePosterior) {
  GreyBoxOptions still = near({});
  still.max_iterations = 0;
  ASSERT_EQ(best_.point.loudness.size(), 3u);
  for (std::size_t r = 0; r < 3; ++r)
    for (const double change : {-0.1, 0.1}) {
      GreyBoxPoint other = best_.point;
      other.loudness[r] += change;
      EXPECT_LT(box_.fit(other, still).log_posterior, best_.log_posterior - 1e-3) << r;
    }
}

TEST_F(Ascent, LouderRunsAreFoundLouder) {
  std::vector<RunData> runs = disturbedRuns(truth_, 0.02, 2, 40);
  runs.push_back(disturbedRun(truth_, pushes(truth_, 0.06), 42));
  const GreyBox box(runs, truth_.body);
  const GreyBoxFit fit = box.fit(box.start(truth_), far({}));
  // The factor of three is shared with the prior of loudness, which favours equal runs.
  const std::vector<double>& loudness = fit.point.loudness;
  EXPECT_NEAR(loudness[2] - 0.5 * (loudness[0] + loudness[1]), std::log(3), 0.4);
  GreyBoxOptions still = near({});
  still.max_iterations = 0;
  for (std::size_t r = 0; r < 3; ++r)
    for (const double change : {-0.05, 0.05}) {
      GreyBoxPoint other = fit.point;
      other.loudness[r] += change;
      EXPECT_LT(box.fit(other, still).log_posterior, fit.log_posterior) << r;
    }
}

TEST_F(Ascent, InformationAboutLoudnessIsThatAboutTheLevelsThatItScales) {
  const Eigen::MatrixXd& information = best_.level_information;
  constexpr Eigen::Index kCount = DisturbanceLevels::kCount;
  ASSERT_EQ(information.rows(), kCount + 3);
  EXPECT_EQ(information, information.transpose());
  const LevelPrior prior(truth_.body);
  Eigen::MatrixXd levels = information.topLeftCorner<kCount, kCount>();
  for (Eigen::Index i = 0; i < kCount; ++i)
    levels(i, i) -= std::pow(prior.deviation[static_cast<std::size_t>(i)], -2);
  Eigen::VectorXd scaled = Eigen::VectorXd::Zero(kCount);  // sigma and white
  for (const Eigen::Index i : {0, 1, 2, 3, 8, 9, 10}) scaled(i) = 1;
  const Eigen::MatrixXd across = information.block<kCount, 3>(0, kCount);
  EXPECT_LT((across.rowwise().sum() - levels * scaled).norm(), 1e-9 * across.norm());
  for (Eigen::Index r = 0; r < 3; ++r)
    EXPECT_NEAR(information(kCount + r, kCount + r) - scaled.dot(across.col(r)), 1 / 0.25, 1e-9);
}

TEST_F(Ascent, ALevelChangesByAFactorOfEAtMostInOneStep) {
  GreyBoxOptions once = near({});
  once.max_iterations = 1;
  int longest = 0;
  for (const double factor : {0.02, 50.0}) {
    GreyBoxPoint start = best_.point;
    start.levels.sigma *= factor;
    start.levels.white *= factor;
    start.levels.time /= factor;
    const GreyBoxFit fit = box_.fit(start, once);
    EXPECT_EQ(fit.iterations, 1);
    EXPECT_FALSE(fit.converged);
    const auto before = start.levels.values(), after = fit.point.levels.values();
    for (std::size_t i = 0; i < before.size(); ++i) {
      const double step = std::abs(std::log(after[i] / before[i]));
      EXPECT_LE(step, 1 + 1e-9) << DisturbanceLevels::names()[i];
      longest += step > 1 - 1e-9;
    }
    for (std::size_t r = 0; r < 3; ++r)
      EXPECT_LE(std::abs(fit.point.loudness[r] - start.loudness[r]), 1 + 1e-9);
  }
  EXPECT_GT(longest, 0);
}

TEST_F(Ascent, HeldLevelsAndFixedParametersKeepTheirValues) {
  GreyBoxPoint start = box_.start(truth_);
  start.model.setValue("X_u", 1.1 * truth_.value("X_u"));
  GreyBoxOptions options = near({"k"});
  options.held = {"sigma_Y", "time_N", "heading", "thrust"};
  const GreyBoxFit fit = box_.fit(start, options);
  const auto& names = DisturbanceLevels::names();
  const auto before = start.levels.values(), after = fit.point.levels.values();
  for (std::size_t i = 0; i < names.size(); ++i) {
    const bool held = std::count(options.held.begin(), options.held.end(), names[i]) > 0;
    EXPECT_EQ(std::abs(std::log(after[i] / before[i])) < 1e-12, held) << names[i];
  }
  EXPECT_EQ(fit.point.model.value("X_u"), start.model.value("X_u"));
  EXPECT_NE(fit.point.model.value("k"), start.model.value("k"));
  options.levels = false;
  EXPECT_EQ(box_.fit(start, options).point.levels.values(), before);
  options.held = {"no_such"};
  EXPECT_THROW(box_.fit(start, options), std::invalid_argument);
}

TEST_F(Ascent, ACommonChangeOfThrustIsAParameterAndNoTrim) {
  // Trims of thrust explain a wrong k, too, but only their differences belong to the runs.
  for (const double factor : {0.6, 1.7}) {
    GreyBoxPoint start = best_.point;
    start.model.setValue("k", factor * start.model.value("k"));
    start.levels.thrust = 0.5;
    const GreyBoxFit fit = box_.fit(start, near());
    EXPECT_NEAR(fit.log_posterior, best_.log_posterior, 0.1) << factor;
    double mean = 0;
    for (const RunTrim& trim : fit.trims) mean += trim.thrust / 3;
    EXPECT_LT(std::abs(mean), 0.02);
  }
}

TEST_F(Ascent, TheMeanChangeOfThrustIsMovedIntoItsParameter) {
  GreyBoxOptions still = near({"X_u", "k"});
  still.max_iterations = 0;
  const auto unchanged = [&](const GreyBoxPoint& start, const GreyBoxOptions& options) {
    const GreyBoxFit fit = box_.fit(start, options);
    return fit.point.model.values() == start.model.values() &&
           fit.point.levels.values() == start.levels.values();
  };
  EXPECT_TRUE(unchanged(best_.point, still)) << "a small mean stays";
  for (const double factor : {0.7, 1.4}) {
    GreyBoxPoint start = best_.point;
    start.model.setValue("k", factor * start.model.value("k"));
    start.levels.thrust = 0.5;
    std::vector<double> changes;
    for (int r = 0; r < 3; ++r)
      changes.push_back(
          box_.residuals(start, r, still.cap, {}).constants.bottomRows<1>()(3));
    const double mean = (changes[0] + changes[1] + changes[2]) / 3;
    double square = 0;
    for (const double change : changes) square += std::pow(change - mean, 2) / 3;
    ASSERT_GT(std::abs(mean), 0.1);
    const GreyBoxFit fit = box_.fit(start, still);
    EXPECT_EQ(fit.iterations, 0);
    EXPECT_NEAR(fit.point.model.value("k"), (1 + mean) * start.model.value("k"), 1e-9);
    EXPECT_EQ(fit.point.model.value("X_u"), start.model.value("X_u"));
    EXPECT_NEAR(fit.point.levels.thrust, std::max(1e-3, std::sqrt(square)), 1e-9);
    EXPECT_EQ(fit.point.levels.sigma, start.levels.sigma);
    GreyBoxOptions fixed = near({"X_u"}), held = still, constant = still;
    fixed.max_iterations = 0;
    held.held = {"thrust"};
    constant.levels = false;
    for (const GreyBoxOptions& options : {fixed, held, constant})
      EXPECT_TRUE(unchanged(start, options));
  }
}

TEST_F(Ascent, AParameterOnItsBoundIsAsIfItWereFixedThere) {
  // Thrust that grows with speed acts like a negative damping, which the model does not allow.
  Model driven = truth_;
  driven.setValue("X_u", 0);
  driven.addEffect(makeEffect("thrust_speed_loss"));
  driven.setValue("thrust_speed_loss.c", -0.2);
  const GreyBox box(disturbedRuns(driven, 0.01, 3, 21), truth_.body);
  const GreyBoxFit found = box.fit(box.start(truth_), far());
  EXPECT_TRUE(found.converged);
  EXPECT_EQ(found.point.model.value("X_u"), 0);
  Model without = truth_;
  without.setValue("X_u", 0);
  const GreyBoxFit fixed = box.fit(box.start(without), far({"I_z", "Y_v", "N_r", "k"}));
  EXPECT_NEAR(found.log_posterior, fixed.log_posterior, 0.05);
  for (const FittedParameter& p : fixed.parameters)
    EXPECT_NEAR(found.point.model.value(p.name), p.value, 0.05 * p.deviation) << p.name;
  for (const FittedParameter& p : found.parameters) EXPECT_EQ(p.at_bound, p.name == "X_u");
  // From the bound on, too, and a parameter leaves it if the posterior rises inwards.
  const GreyBoxFit again = box.fit(found.point, near());
  EXPECT_EQ(again.point.model.value("X_u"), 0);
  EXPECT_NEAR(again.log_posterior, found.log_posterior, 0.02);
  GreyBoxPoint bounded = best_.point;
  bounded.model.setValue("X_u", 0);
  EXPECT_NEAR(box_.fit(bounded, near()).log_posterior, best_.log_posterior, 0.1);
}

TEST_F(Ascent, RefusesAStartWhoseMotionIsNotFinite) {
  GreyBoxPoint start = best_.point;
  start.model.setValue("I_z", 1e-300);
  start.model.setValue("N_r", 1e300);
  EXPECT_THROW(box_.fit(start, near()), std::runtime_error);
}

}  // namespace
}  // namespace ground

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
