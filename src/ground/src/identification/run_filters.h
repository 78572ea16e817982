// The filters of all recordings at a point of the space that is searched.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "disturbance_filter.h"
#include "ground/identification/grey_box.h"

namespace ground::detail {

using LevelVector = Eigen::Matrix<double, kLevels, 1>;

constexpr double kLoudness = 0.5;  // deviation of its prior

/// Logarithms of the levels, and back.
LevelVector logs(const DisturbanceLevels& levels);
DisturbanceLevels fromLogs(const LevelVector& logs);

/// The levels of one run, its loudness included.
DisturbanceLevels levelsOf(const GreyBoxPoint& point, std::size_t run);

/// All but evaluate() are of the point that it was called with last. Sums are over the runs.
class RunFilters {
 public:
  RunFilters(const std::vector<RunData>& runs, double max_gap, int threads);

  /// The log-likelihood, not finite where the motion is not.
  double evaluate(const GreyBoxPoint& point, double cap);

  /// One block a run; the information with the parameters' prior.
  RunScores scores(const GreyBoxPoint& point, const Free& free) const;
  /// Level scores of each run.
  std::vector<RunLevelScores> levelScores(const GreyBoxPoint& point) const;

  const std::vector<DisturbanceFilter>& filters() const { return filters_; }
  const std::vector<double>& byRun() const { return by_run_; }

 private:
  int threads_;
  std::vector<DisturbanceFilter> filters_;
  std::vector<double> by_run_;
};

}  // namespace ground::detail
