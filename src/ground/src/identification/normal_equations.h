// Residuals of windows, and their normal equations under a loss.
#pragma once

#include <Eigen/Core>
#include <utility>
#include <vector>

#include "ground/model/lanes.h"
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

/// Derivatives of a window's residuals, a row each. The columns are the free parameters, then the
/// initial state, then zeros up to a multiple of eight.
using Derivatives = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// Residuals of a window at some parameters and initial state.
struct WindowResiduals {
  int window;
  bool finite;                ///< whether the simulation is finite
  Eigen::VectorXd residuals;  ///< u, v, r (or x, y, psi) of each sample in turn
  Derivatives derivatives;    ///< empty unless requested
};

/// Residuals and derivatives of up to eight windows in lanes: three rows a visit.
struct LaneRows {
  std::vector<Lanes> residuals;
  std::vector<Lanes> derivatives;  ///< `stride` per residual: the columns, then zeros
  int stride = 0;

  /// Allocates rows; derivatives beyond the columns are zero.
  void prepare(int rows, int columns);
};

/// Normal equations of the rows [first, last) and the first `columns` columns of J.
NormalEquations normalEquations(const WindowResiduals& rows, int columns, int first, int last,
                                const Weigh& weigh);

/// Sums of the normal equations of up to eight windows in lanes.
class LaneSums {
 public:
  explicit LaneSums(int columns);
  void add(const LaneRows& rows, int first, int last, const Weigh& weigh);
  /// Sets `result` to the sums of one lane, and these sums to zero.
  void take(int lane, NormalEquations& result);

 private:
  int columns_, blocks_;
  std::vector<Lanes> A_;  ///< blocks on and above the diagonal
  std::vector<Lanes> b_;
  Lanes loss_ = 0.0;
};

/// Sum of the losses of each lane.
Lanes losses(const std::vector<Lanes>& residuals, const Weigh& weigh);

}  // namespace ground::detail
