// What the Fisher information of a fit says of its parameters.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "free_parameters.h"
#include "ground/identification/simulation_error.h"

namespace ground::detail {

/// How well each parameter is known.
struct Known {
  Eigen::VectorXd variance;      ///< of coordinates over scale, by the directions that are seen
  std::vector<bool> identified;  ///< false: takes part in a direction that is not
  Eigen::MatrixXd unseen;        ///< orthonormal columns: directions along which nothing changes
  double volume;                 ///< logarithm of the information's determinant, as far as seen
};

/// By the Fisher information (n, n) of coordinates over scale.
Known knownBy(const Eigen::MatrixXd& information);

/// Values with 95% intervals; `freedom`: degrees of each parameter, none: the levels of what is
/// random count as known.
std::vector<FittedParameter> estimatesBy(const Known& known, const Model& model, const Free& free,
                                         const std::vector<double>& scaled,
                                         const std::vector<double>& freedom);

}  // namespace ground::detail
