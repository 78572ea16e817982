// A quadratic's minimum in a box.
#pragma once

#include <Eigen/Core>

namespace ground::detail {

/// The s that minimises g's + s'As / 2 with lower <= s <= upper, by an active set: elements that the solution
/// takes across a bound are held on it, until the slope leads inwards.
Eigen::VectorXd projectedStep(const Eigen::MatrixXd& A, const Eigen::VectorXd& g,
                              const Eigen::VectorXd& lower, const Eigen::VectorXd& upper);

}  // namespace ground::detail
