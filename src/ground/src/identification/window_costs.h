// All windows as one least-squares problem of ceres.
#pragma once

#include <ceres/ceres.h>

#include <vector>

#include "free_parameters.h"
#include "linearisation.h"

namespace ground::detail {

/// The costs of all windows at one point, evaluated together whenever the solver moves.
///
/// A window's residuals r (after the loss) and derivatives J have hundreds of rows. ceres gets a
/// few rows of the Cholesky factor R of [J r]'[J r] = R'R instead, which has the same sum of
/// squares and the same normal equations. With columns ordered as initial state, free parameters,
/// residual, the first rows of R involve the window's initial state and form its own cost. The
/// remaining block of [J r]'[J r] depends only on the free parameters; it is summed over all
/// windows and factorised once, as their shared cost.
class WindowCosts : public ceres::EvaluationCallback {
 public:
  /// Variables are `scaled` (unless empty) and the windows' initial states. All arguments must
  /// outlive it.
  WindowCosts(Linearisation& windows, const Free& free, const RobustLoss& robust, std::vector<double>& scaled,
              Initials& initial);

  void addTo(ceres::Problem& solver);

  void PrepareForEvaluation(bool derivatives, bool moved) override;

 private:
  class OwnCost;
  class SharedCost;
  /// Columns are the initial state, the free parameters, the residual.
  struct Share {
    bool finite;
    Eigen::MatrixXd own;     ///< rows of the Cholesky factor, one for each initial state variable
    Eigen::MatrixXd shared;  ///< Schur complement: the rest of [J r]'[J r] in the other columns
  };
  void eliminate(const NormalEquations& equations, Share& share) const;

  Linearisation& all_;
  const Free& free_;
  const RobustLoss robust_;
  std::vector<double>& scaled_;
  Initials& initial_;
  std::vector<double> losses_;  ///< loss of each window, from evaluations without derivatives
  std::vector<Share> windows_;
  Eigen::MatrixXd shared_;  ///< Cholesky factor of the sum of all Share::shared
  bool has_derivatives_ = false;
};

}  // namespace ground::detail
