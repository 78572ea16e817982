// Parameters that a fit may change, in numbers of order one.
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "ground/model/model.h"

namespace ground::detail {

/// Scaling between solver variables of order one and coordinates of the model.
struct Free {
  std::vector<double> base;  ///< coordinates of all parameters, the free ones at their start
  std::vector<int> index;
  std::vector<double> scale, lower, upper;  ///< bounds in coordinates
  std::vector<bool> reciprocal;             ///< the value is one over the coordinate
  /// Precision and mean of their prior, by coordinates over scale.
  Eigen::MatrixXd prior;
  Eigen::VectorXd expected;

  std::vector<double> coordinates(const double* scaled) const {
    std::vector<double> all = base;
    for (std::size_t i = 0; i < index.size(); ++i) all[index[i]] = scaled[i] * scale[i];
    return all;
  }
  /// Whether the value grows with the coordinate, or falls.
  double sign(int i) const { return reciprocal[i] ? -1 : 1; }
  /// Sign of the way from the bound that a value sits on into the range; 0 inside the range. A step
  /// that is cut off short of the bound by rounding is on it.
  int inward(std::size_t i, double scaled) const {
    constexpr double kOnBound = 1e-7;
    return scaled - lower[i] / scale[i] <= kOnBound   ? 1
           : upper[i] / scale[i] - scaled <= kOnBound ? -1
                                                      : 0;
  }
};

/// The named parameters at the model's values. Throws std::invalid_argument on an unknown or
/// repeated name and on masses, levers and thrusts that motion does not distinguish.
Free makeFree(const Model& model, const std::vector<std::string>& names);

}  // namespace ground::detail
