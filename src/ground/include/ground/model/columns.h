#pragma once

#include <Eigen/Core>

namespace ground {

/// The X of A X = B from a decomposition of A (of any of Eigen's that solve), column by column: Eigen's
/// algorithm for many columns at once is for large matrices and takes seconds to compile.
template <class Decomposition, class Matrix>
Matrix solvedByColumns(const Decomposition& A, const Matrix& B) {
  Matrix X = B;
  Eigen::Matrix<double, Matrix::RowsAtCompileTime, 1, 0, Matrix::MaxRowsAtCompileTime, 1> column;
  for (Eigen::Index j = 0; j < B.cols(); ++j) {
    column = B.col(j);
    A.solveInPlace(column);
    X.col(j) = column;
  }
  return X;
}

}  // namespace ground
