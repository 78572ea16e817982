// Estimates of the parameters of a fit, with intervals.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "uncertainty.h"

namespace ground::detail {

/// Correlation of the estimates, (n, n).
Eigen::MatrixXd correlationOf(const Uncertainty& u, const Free& free);

/// Condition number of the scaled information; infinite if it is singular.
double conditionOf(const Uncertainty& u);

/// 97.5% quantile of Student's t, for 95% intervals.
double quantileOf(double freedom);

/// Estimate of the free parameter `i`, with the interval of `quantile` deviations to either side.
/// `before` is its value before the fit. `scaled` and `deviation` are those of its coordinate over
/// its scale; an infinite deviation means that it is not identifiable from the data.
FittedParameter estimateOf(const ParameterInfo& info, const Free& free, std::size_t i, double scaled,
                           double deviation, double quantile, double before);

/// Values with 95% intervals by Student's t; `scaled` are the fitted coordinates over scale.
std::vector<FittedParameter> intervalsOf(const Uncertainty& u, const Free& free,
                                         const std::vector<double>& scaled, const Model& start,
                                         const Model& fitted);

}  // namespace ground::detail
