// The thesis's table 3.1: errors of the estimates over noise. `make bench` prints it.
#include <gtest/gtest.h>

#include "../artificial_run.h"

namespace ground {
namespace table_3_1_test {

constexpr unsigned kSeeds = 50;
constexpr auto kLeastSquares = FitOptions::Objective::kLeastSquares;

TEST(CleanData, GiveTheTruth) { EXPECT_LT(studyNoise(0, kSeeds, kLeastSquares).largest, 1e-4); }

struct Case {
  double epsilon, median;
};

class TableThreeOne : public testing::TestWithParam<Case> {};

TEST_P(TableThreeOne, ErrorsAreSmallAndIntervalsCoverTheTruth) {
  const NoiseStudy study = studyNoise(GetParam().epsilon, kSeeds, kLeastSquares);
  RecordProperty("median_percent", std::to_string(100 * study.median));
  RecordProperty("coverage_percent", std::to_string(study.coverage.percent()));
  EXPECT_LE(study.median, GetParam().median);
  EXPECT_GE(study.coverage.percent(), 90);
  EXPECT_LE(study.coverage.percent(), 99);
}

INSTANTIATE_TEST_SUITE_P(Noise, TableThreeOne,
                         testing::Values(Case{0.1, 0.02}, Case{0.3, 0.06}, Case{0.5, 0.10}));

}  // namespace table_3_1_test
}  // namespace ground
