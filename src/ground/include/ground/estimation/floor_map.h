#pragma once

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>
#include <vector>

namespace ground {

/// Means of a quantity by cells of the floor.
class FloorMap {
 public:
  struct Cell {
    double x, y;  ///< centre [m]
    double mean;
  };

  explicit FloorMap(double cell) : cell_(cell) {}

  double cell() const { return cell_; }  ///< side of a cell [m]
  void add(double x, double y, double value) {
    if (!std::isfinite(x + y + value) || std::abs(x) > kMaxDistance || std::abs(y) > kMaxDistance) return;
    auto& [sum, count] = cells_[{index(x), index(y)}];
    sum += value;
    ++count;
  }
  /// All cells with at least kMinCount values.
  std::vector<Cell> cells() const {
    std::vector<Cell> found;
    for (const auto& [at, seen] : cells_) {
      if (seen.second < kMinCount) continue;
      found.push_back({(at.first + 0.5) * cell_, (at.second + 0.5) * cell_, seen.first / seen.second});
    }
    return found;
  }
  /// 95% quantile of the means, for scaling; never 0.
  double large() const {
    std::vector<double> means{1e-12};
    for (const Cell& c : cells()) means.push_back(c.mean);
    const auto at = means.begin() + static_cast<long>(0.95 * static_cast<double>(means.size() - 1));
    std::nth_element(means.begin(), at, means.end());
    return std::max(*at, 1e-12);
  }

 private:
  int index(double x) const { return static_cast<int>(std::floor(x / cell_)); }

  static constexpr int kMinCount = 5;
  static constexpr double kMaxDistance = 50;  // no room is larger [m]

  double cell_;
  std::map<std::pair<int, int>, std::pair<double, int>> cells_;
};

}  // namespace ground
