// Estimates of parameters, with intervals, from the information of a fit.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "free_parameters.h"
#include "ground/identification/simulation_error.h"

namespace ground::detail {

/// What the information I (n, n) about n coordinates over scale identifies.
struct Identifiable {
  std::vector<bool> parameter;  ///< false if the parameter changes along the null space
  Eigen::MatrixXd directions;   ///< columns d with d'I d = 1, orthogonal under I
  Eigen::MatrixXd null_space;   ///< orthonormal columns: directions that are not identifiable
  double log_determinant = 0;   ///< of I, up to a constant, without the null space

  /// Variances of the coordinates, from the identifiable directions.
  Eigen::VectorXd variance() const { return directions.rowwise().squaredNorm(); }
};
Identifiable identifiableBy(const Eigen::MatrixXd& information);

/// 97.5% quantile of Student's t, for 95% intervals.
double quantileOf(double freedom);

/// Estimates of the free parameters at coordinates over scale, with intervals of `quantile` standard
/// deviations to either side. An infinite deviation means that a parameter is not identifiable.
std::vector<FittedParameter> estimatesOf(const Model& model, const Free& free,
                                         const std::vector<double>& scaled, const Eigen::VectorXd& deviation,
                                         const Eigen::VectorXd& quantile);

}  // namespace ground::detail
