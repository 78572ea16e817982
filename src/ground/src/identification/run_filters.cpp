#include "run_filters.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <stdexcept>

#include "parallel.h"

namespace ground::detail {

LevelVector logs(const DisturbanceLevels& levels) {
  LevelVector result;
  const auto values = levels.values();
  for (int i = 0; i < kLevels; ++i) result(i) = std::log(values[i]);
  return result;
}

DisturbanceLevels fromLogs(const LevelVector& logs) {
  std::array<double, kLevels> values;
  for (int i = 0; i < kLevels; ++i) values[i] = std::exp(logs(i));
  return DisturbanceLevels::of(values);
}

std::set<int> levelIndices(const std::vector<std::string>& names) {
  const auto& known = DisturbanceLevels::names();
  std::set<int> found;
  for (const std::string& name : names) {
    const auto at = std::find(known.begin(), known.end(), name);
    if (at == known.end()) throw std::invalid_argument("there is no level '" + name + "'");
    found.insert(static_cast<int>(at - known.begin()));
  }
  return found;
}

DisturbanceLevels levelsOf(const GreyBoxPoint& point, std::size_t run) {
  DisturbanceLevels levels = point.levels;
  if (!point.log_scales.empty()) {
    const double factor = std::exp(point.log_scales[run]);
    levels.sigma *= factor;
    levels.sigma_room *= factor;
    levels.white *= factor;
  }
  return levels;
}

RunFilters::RunFilters(const std::vector<RunData>& runs, int threads) : threads_(threads) {
  for (const RunData& run : runs) filters_.emplace_back(run);
  by_run_.resize(runs.size());
}

double RunFilters::evaluate(const GreyBoxPoint& point, double cap) {
  inParallel(filters_.size(), threads_,
             [&](std::size_t i) { by_run_[i] = filters_[i].run(point.model, levelsOf(point, i), cap); });
  return std::accumulate(by_run_.begin(), by_run_.end(), 0.0);
}

RunScores RunFilters::scores(const GreyBoxPoint& point, const Free& free) const {
  std::vector<RunScores> found(filters_.size());
  inParallel(filters_.size(), threads_,
             [&](std::size_t i) { found[i] = filters_[i].scores(point.model, free, 1e9); });
  for (std::size_t i = 1; i < found.size(); ++i) {
    found[0].score += found[i].score;
    found[0].information += found[i].information;
    found[0].by_acceleration += found[i].by_acceleration;
  }
  found[0].information += free.prior;
  found[0].by_acceleration += free.prior;
  return found[0];
}

std::vector<RunLevelScores> RunFilters::levelScores(const GreyBoxPoint& point,
                                                    const std::set<int>& held) const {
  std::vector<RunLevelScores> found(filters_.size());
  inParallel(filters_.size(), threads_,
             [&](std::size_t i) { found[i] = filters_[i].levelScores(levelsOf(point, i), held); });
  return found;
}

}  // namespace ground::detail
