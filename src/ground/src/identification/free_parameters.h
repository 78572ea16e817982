// The free parameters of a fit, scaled to order one.
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "ground/identification/simulation_error.h"
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
  /// Mean and precision of what a user knows beforehand of coordinates over scale (0: nothing), and the
  /// weight of the precision in a loss over windows.
  Eigen::VectorXd known, precision;
  double weight = 0;

  bool kept(std::size_t i) const { return lower[i] == upper[i]; }
  std::vector<double> coordinates(const double* scaled) const {
    std::vector<double> all = base;
    for (std::size_t i = 0; i < index.size(); ++i) all[index[i]] = scaled[i] * scale[i];
    return all;
  }
  /// 1 if the value increases with the coordinate, -1 if it decreases.
  double sign(int i) const { return reciprocal[i] ? -1 : 1; }
};

/// The named parameters at the model's values. Throws std::invalid_argument on an unknown or
/// repeated name.
Free makeFree(const Model& model, const std::vector<std::string>& names);

/// Sets what is known of free parameters beforehand. Throws std::invalid_argument on a parameter that is not
/// free and on a deviation that is not positive.
void setPriors(const Model& model, const std::vector<ParameterPrior>& priors, Free& free);

/// Keeps free parameters at their start. Throws std::invalid_argument on an unknown name.
void keep(const Model& model, const std::vector<std::string>& names, Free& free);

/// Throws std::invalid_argument on a set of mass, lever, inertia and thrust that runs cannot identify:
/// motion gives ratios to the mass and the inertia. Runs with different payloads give these themselves.
void requireIdentifiable(const std::vector<std::string>& names, const std::vector<const RunData*>& runs);

/// The start of a search: coordinates over scale.
std::vector<double> startOf(const Free& free);

/// A model with free parameters at other values, clamped to their ranges, which rounding may leave.
Model modelAt(const Model& model, const Free& free, const double* scaled);

}  // namespace ground::detail
