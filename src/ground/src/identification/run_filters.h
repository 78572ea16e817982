// The filters of all recordings at one point of the search space.
#pragma once

#include <Eigen/Core>
#include <set>
#include <string>
#include <vector>

#include "disturbance_filter.h"
#include "ground/identification/grey_box.h"

namespace ground::detail {

using LevelVector = Eigen::Matrix<double, kLevels, 1>;

constexpr double kScaleDeviation = 0.5;  // standard deviation of the prior of a run's log_scale

/// Conversion between levels and their logarithms.
LevelVector logs(const DisturbanceLevels& levels);
DisturbanceLevels fromLogs(const LevelVector& logs);

/// Indices of levels by their names. Throws std::invalid_argument on an unknown name.
std::set<int> levelIndices(const std::vector<std::string>& names);

/// The levels of one run, including its scale.
DisturbanceLevels levelsOf(const GreyBoxPoint& point, std::size_t run);

/// Filters of all runs. First call evaluate(); all other functions refer to the point of its last
/// call.
class RunFilters {
 public:
  RunFilters(const std::vector<RunData>& runs, int threads);

  /// The log-likelihood of all runs; not finite if the motion is not finite.
  [[nodiscard]] double evaluate(const GreyBoxPoint& point, double cap);

  /// Sums over the runs, one block each; the information includes the prior of the parameters.
  RunScores scores(const GreyBoxPoint& point, const Free& free) const;
  /// Level scores of each run; zero for the levels `held`.
  std::vector<RunLevelScores> levelScores(const GreyBoxPoint& point, const std::set<int>& held) const;

  const std::vector<DisturbanceFilter>& filters() const { return filters_; }
  const std::vector<double>& byRun() const { return by_run_; }

 private:
  int threads_;
  std::vector<DisturbanceFilter> filters_;
  std::vector<double> by_run_;
};

}  // namespace ground::detail
