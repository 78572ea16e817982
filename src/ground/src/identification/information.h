// Identifiability and variance of parameters from the Fisher information of a fit.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "free_parameters.h"
#include "ground/identification/simulation_error.h"

namespace ground::detail {

/// How well each parameter is known.
struct Known {
  Eigen::VectorXd variance;      ///< of coordinates over scale, from the identifiable directions
  std::vector<bool> identified;  ///< false if the parameter changes along a direction in `unseen`
  Eigen::MatrixXd unseen;        ///< orthonormal columns: directions that are not identifiable
  double volume;                 ///< log-determinant of the information, identifiable directions
};

/// From the Fisher information (n, n) of coordinates over scale.
Known knownBy(const Eigen::MatrixXd& information);

/// Values with 95% intervals. `freedom`: degrees of freedom of Student's t for each parameter;
/// empty means normal quantiles, which take the levels of the disturbance as known.
std::vector<FittedParameter> estimatesBy(const Known& known, const Model& model, const Free& free,
                                         const std::vector<double>& scaled,
                                         const std::vector<double>& freedom);

}  // namespace ground::detail
