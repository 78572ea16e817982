#pragma once

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>
#include <vector>

namespace ground {

/// Means of something over the cells of the floor in which it was seen.
class FloorMap {
 public:
  struct Cell {
    double x, y;  ///< of its centre [m]
    double mean;
  };

  explicit FloorMap(double cell) : cell_(cell) {}

  double cell() const { return cell_; }  ///< side of a cell [m]
  void add(double x, double y, double value) {
    if (!std::isfinite(x + y + value) || std::abs(x) > kFarthest || std::abs(y) > kFarthest) return;
    auto& [sum, count] = cells_[{index(x), index(y)}];
    sum += value;
    ++count;
  }
  /// Those with enough values to say something.
  std::vector<Cell> cells() const {
    std::vector<Cell> found;
    for (const auto& [at, seen] : cells_) {
      if (seen.second < kFewest) continue;
      found.push_back(
          {(at.first + 0.5) * cell_, (at.second + 0.5) * cell_, seen.first / seen.second});
    }
    return found;
  }
  /// What all but the worst of the means keep below; never 0.
  double large() const {
    std::vector<double> means{1e-12};
    for (const Cell& c : cells()) means.push_back(c.mean);
    const auto at = means.begin() + static_cast<long>(0.95 * static_cast<double>(means.size() - 1));
    std::nth_element(means.begin(), at, means.end());
    return std::max(*at, 1e-12);
  }

 private:
  int index(double x) const { return static_cast<int>(std::floor(x / cell_)); }

  static constexpr int kFewest = 5;
  static constexpr double kFarthest = 50;  // no room is larger [m]

  double cell_;
  std::map<std::pair<int, int>, std::pair<double, int>> cells_;
};

}  // namespace ground
