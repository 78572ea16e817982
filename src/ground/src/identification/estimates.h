// What a fit says of its parameters.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "uncertainty.h"

namespace ground::detail {

/// Correlation of the estimates, (n, n).
Eigen::MatrixXd correlationOf(const Uncertainty& u, const Free& free);

/// Condition number of the scaled information; infinite when it is singular.
double conditionOf(const Uncertainty& u);

/// Values with 95% intervals by Student's t; `scaled` are the fitted coordinates over scale.
std::vector<FittedParameter> intervalsOf(const Uncertainty& u, const Free& free,
                                         const std::vector<double>& scaled, const Model& start,
                                         const Model& fitted);

}  // namespace ground::detail
