// The search for the maximum of the stochastic likelihood's posterior.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "../crafts.h"
#include "../disturbed_run.h"
#include "../sanitized.h"

namespace ground {
namespace likelihood_maximiser_test {

GreyBoxOptions warm(std::vector<std::string> free = kNominal) {
  GreyBoxOptions options = cold(std::move(free));
  options.warm = true;
  return options;
}

class Maximum : public testing::Test {
 protected:
  const Model truth_ = craft();
  const GreyBox box_{disturbedRuns(truth_, 0.03, 3, 11), truth_.body};
  const GreyBoxFit best_ = box_.fit(box_.start(truth_), cold());
};

TEST_F(Maximum, IsTheSameFromEverywhere) {
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
  for (const double scale : {-2.0, 2.0}) {
    starts.push_back(best_.point);
    starts.back().log_scales = {scale, 0.0, -scale};
  }
  if (kSanitized) starts.erase(starts.begin() + 2, starts.end());
  for (std::size_t i = 0; i < starts.size(); ++i) {
    const GreyBoxFit fit = box_.fit(starts[i], warm());
    EXPECT_TRUE(fit.converged) << i;
    EXPECT_NEAR(fit.log_posterior, best_.log_posterior, 0.1) << i;
  }
}

TEST_F(Maximum, ScalesOfRunsAreFound) {
  std::vector<RunData> runs = disturbedRuns(truth_, 0.02, 2, 40);
  runs.push_back(disturbedRun(truth_, pushes(truth_, 0.06), 42));
  const GreyBox box(runs, truth_.body);
  const GreyBoxFit fit = box.fit(box.start(truth_), cold({}));
  // The factor of three is shared with the prior of scales, which favours equal runs.
  const std::vector<double>& scales = fit.point.log_scales;
  EXPECT_NEAR(scales[2] - 0.5 * (scales[0] + scales[1]), std::log(3), 0.4);
  GreyBoxOptions still = warm({});
  still.max_iterations = 0;
  for (std::size_t r = 0; r < 3; ++r)
    for (const double change : {-0.05, 0.05}) {
      GreyBoxPoint other = fit.point;
      other.log_scales[r] += change;
      EXPECT_LT(box.fit(other, still).log_posterior, fit.log_posterior) << r;
    }
}

TEST_F(Maximum, HeldLevelsAndFixedParametersKeepTheirValues) {
  GreyBoxPoint start = box_.start(truth_);
  start.model.setValue("X_u", 1.1 * truth_.value("X_u"));
  GreyBoxOptions options = warm({"k"});
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

TEST_F(Maximum, ACommonChangeOfThrustIsAParameterAndNoTrim) {
  // Trims of thrust explain a wrong k, too, but only their differences belong to the runs.
  for (const double factor : {0.6, 1.7}) {
    GreyBoxPoint start = best_.point;
    start.model.setValue("k", factor * start.model.value("k"));
    start.levels.thrust = 0.5;
    const GreyBoxFit fit = box_.fit(start, warm());
    EXPECT_NEAR(fit.log_posterior, best_.log_posterior, 0.1) << factor;
    double mean = 0;
    for (const RunTrim& trim : fit.trims) mean += trim.thrust / 3;
    EXPECT_LT(std::abs(mean), 0.02);
  }
}

TEST_F(Maximum, AParameterOnItsBoundIsAsIfItWereFixedThere) {
  // Thrust that grows with speed acts like a negative damping, which the model does not allow.
  const Model driven = withValues(truth_, {{"X_u", 0}, {"thrust_speed_loss.c", -0.2}});
  const GreyBox box(disturbedRuns(driven, 0.01, 3, 21), truth_.body);
  const GreyBoxFit found = box.fit(box.start(truth_), cold());
  EXPECT_TRUE(found.converged);
  EXPECT_EQ(found.point.model.value("X_u"), 0);
  const GreyBoxFit fixed =
      box.fit(box.start(withValues(truth_, {{"X_u", 0}})), cold({"I_z", "Y_v", "N_r", "k"}));
  EXPECT_NEAR(found.log_posterior, fixed.log_posterior, 0.05);
  for (const FittedParameter& p : fixed.parameters)
    EXPECT_NEAR(found.point.model.value(p.name), p.value, 0.05 * p.deviation) << p.name;
  for (const FittedParameter& p : found.parameters) EXPECT_EQ(p.at_bound, p.name == "X_u");
  // From the bound on, too, and a parameter leaves it if the posterior rises inwards.
  const GreyBoxFit again = box.fit(found.point, warm());
  EXPECT_EQ(again.point.model.value("X_u"), 0);
  EXPECT_NEAR(again.log_posterior, found.log_posterior, 0.02);
  GreyBoxPoint bounded = best_.point;
  bounded.model.setValue("X_u", 0);
  EXPECT_NEAR(box_.fit(bounded, warm()).log_posterior, best_.log_posterior, 0.1);
}

TEST_F(Maximum, RefusesAStartWhoseMotionIsNotFinite) {
  GreyBoxPoint start = best_.point;
  start.model.setValue("I_z", 1e-300);
  start.model.setValue("N_r", 1e300);
  EXPECT_THROW(box_.fit(start, warm()), std::runtime_error);
}

}  // namespace likelihood_maximiser_test
}  // namespace ground
