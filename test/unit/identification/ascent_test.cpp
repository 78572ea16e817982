// The search for the maximum of the stochastic likelihood's posterior.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "../disturbed_run.h"
#include "ground/model/effect_registry.h"

namespace ground {
namespace ascent_test {

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
    if (getenv("SHOW")) printf("%zu %d %g\n", i, fit.iterations, fit.log_posterior - best_.log_posterior);
  }
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
                                    : room                  ? std::make_pair(1.0, 2.7)
                                    : kind == "sigma"       ? std::make_pair(0.02 * full, 4.5)
                                    : kind == "white"       ? std::make_pair(0.001 * full, 4.5)
                                    : kind == "trim"        ? std::make_pair(0.003 * full, 4.5)
                                    : kind == "time"        ? std::make_pair(0.3, 2.7)
                                    : kind == "thrust"      ? std::make_pair(0.01, 2.0)
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

}  // namespace ascent_test
}  // namespace ground
