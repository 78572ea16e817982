// The free parameters of a fit, scaled to order one.
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "ground/model/model.h"

namespace ground::detail {

/// Scaling between solver variables of order one and coordinates of the model.
struct Free {
  std::vector<double> base;                 ///< coordinates of all parameters, the free ones at their start
  std::vector<int> index;                   ///< indices of the free parameters in Model::parameters()
  std::vector<double> scale, lower, upper;  ///< bounds in coordinates
  std::vector<bool> reciprocal;             ///< the coordinate is 1/value
  /// Precision and mean of the prior of coordinates over scale.
  Eigen::MatrixXd prior;
  Eigen::VectorXd expected;

  std::vector<double> coordinates(const double* scaled) const {
    std::vector<double> all = base;
    for (std::size_t i = 0; i < index.size(); ++i) all[index[i]] = scaled[i] * scale[i];
    return all;
  }
  /// 1 if the value increases with the coordinate, -1 if it decreases.
  double sign(int i) const { return reciprocal[i] ? -1 : 1; }
  /// Direction from a bound into the range: 1 on the lower bound, -1 on the upper bound, 0 inside.
  /// The tolerance allows for steps that rounding cuts before the bound.
  int inward(std::size_t i, double scaled) const {
    constexpr double kOnBound = 1e-7;
    return scaled - lower[i] / scale[i] <= kOnBound ? 1 : upper[i] / scale[i] - scaled <= kOnBound ? -1 : 0;
  }
};

/// The named parameters at the model's values. Throws std::invalid_argument on an unknown or
/// repeated name, and on a set of mass, lever, inertia and thrust that is not identifiable.
Free makeFree(const Model& model, const std::vector<std::string>& names);

}  // namespace ground::detail
