// All windows as one least-squares problem of ceres.
#pragma once

#include <ceres/ceres.h>

#include <vector>

#include "free_parameters.h"
#include "linearisation.h"

namespace ground::detail {

/// The costs of all windows at one point, evaluated together whenever the solver moves. A window's
/// residuals r (after the loss) and derivatives J, hundreds of rows, are passed on as a few rows of
/// the Cholesky factor of [J r]'[J r]: the sum of squares and the normal equations are the same.
/// Those that the window's initial state takes part in are the window's own; the others are added
/// up and shared by all.
class WindowCosts : public ceres::EvaluationCallback {
 public:
  /// Variables are `scaled` (unless there are none) and the windows' initial states; all has to
  /// outlive it.
  WindowCosts(Linearisation& windows, const Free& free, const RobustLoss& robust,
              std::vector<double>& scaled, Initials& initial);

  void addTo(ceres::Problem& solver);

  void PrepareForEvaluation(bool derivatives, bool moved) override;

 private:
  class OwnCost;
  class SharedCost;
  /// Columns are the initial state, the free parameters, the residual.
  struct Share {
    bool finite = false;
    Eigen::MatrixXd own;     ///< rows of the Cholesky factor, as many as the initial state has
    Eigen::MatrixXd shared;  ///< what is left of [J r]'[J r] in the other columns
  };
  void eliminate(const NormalEquations& equations, Share& share) const;

  Linearisation& all_;
  const Free& free_;
  const RobustLoss robust_;
  std::vector<double>& scaled_;
  Initials& initial_;
  std::vector<double> losses_;  ///< without derivatives there is no more
  std::vector<Share> windows_;
  Eigen::MatrixXd shared_;  ///< Cholesky factor
  bool has_derivatives_ = false;
};

}  // namespace ground::detail
