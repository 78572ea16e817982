// Residuals of windows, and their normal equations under a loss.
#pragma once

#include <Eigen/Core>
#include <utility>
#include <vector>

#include "ground/model/types.h"
#include "robust_loss.h"

namespace ground::detail {

/// Normal equations: A = J'WJ, b = J's, and the loss. Columns of J are the free parameters, then a
/// window's initial state.
struct NormalEquations {
  Eigen::MatrixXd A;
  Eigen::VectorXd b;
  double loss = 0;

  NormalEquations() = default;
  NormalEquations(Eigen::MatrixXd left, Eigen::VectorXd right, double cost = 0)
      : A(std::move(left)), b(std::move(right)), loss(cost) {}
  static NormalEquations zero(Eigen::Index columns) {
    return {Eigen::MatrixXd::Zero(columns, columns), Eigen::VectorXd::Zero(columns)};
  }

  NormalEquations& operator+=(const NormalEquations& other);
  NormalEquations& operator-=(const NormalEquations& other);
};

/// Residuals of a window at some parameters and initial state.
struct WindowResiduals {
  Eigen::VectorXd residuals;  ///< u, v, r (or x, y, psi) of each sample in turn
  /// For each pass of a simulation with kDerivatives derivatives, those of each residual. Empty unless
  /// requested.
  std::vector<std::vector<Derivatives>> passes;
  int columns = 0;  ///< number of derivatives: by the free parameters, then by the initial state

  WindowResiduals(int rows, int columns);
  bool finite() const;
};

/// Normal equations of the rows [first, last).
NormalEquations normalEquations(const WindowResiduals& rows, int first, int last, const Weigh& weigh);

/// Sum of the losses of all rows.
double lossOf(const Eigen::VectorXd& residuals, const Weigh& weigh);

}  // namespace ground::detail
