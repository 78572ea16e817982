#pragma once

#include <Eigen/Core>

namespace ground::detail {

// Decompositions of dense matrices, each compiled once: Eigen's templates take seconds to compile
// wherever they are used.

/// A = V diag(values) V', values ascending, columns of V orthonormal.
struct Spectrum {
  Eigen::VectorXd values;
  Eigen::MatrixXd vectors;
};
Spectrum spectrumOf(const Eigen::MatrixXd& symmetric);

/// The X of least norm that minimises |A X - B| (complete orthogonal decomposition).
Eigen::MatrixXd leastSquares(const Eigen::MatrixXd& A, const Eigen::MatrixXd& B);

/// X of A X = B for a symmetric A (LDL').
Eigen::MatrixXd solveSymmetric(const Eigen::MatrixXd& A, const Eigen::MatrixXd& B);

/// Orthonormal columns that span those of A, which are independent (Householder QR).
Eigen::MatrixXd orthonormalised(const Eigen::MatrixXd& A);

}  // namespace ground::detail
