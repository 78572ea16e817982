// All windows as one least-squares problem of ceres.
#pragma once

#include <ceres/ceres.h>

#include <vector>

#include "descent.h"

namespace ground {

/// The costs of all windows at one point, evaluated together whenever the solver moves. A window's
/// residuals r (after the loss) and derivatives J, hundreds of rows, are passed on as the few rows
/// of the Cholesky factor of [J r]'[J r]: the sum of squares and the normal equations are the same.
class WindowCosts : public ceres::EvaluationCallback {
 public:
  /// Variables are `scaled` (unless there are none) and the windows' initial states; all has to
  /// outlive it.
  WindowCosts(const SimulationError& problem, const Model& model, const Free& free,
              const Robust& robust, int threads, std::vector<double>& scaled, Initials& initial);

  void addTo(ceres::Problem& solver);

  void PrepareForEvaluation(bool derivatives, bool moved) override;

 private:
  class Cost;
  struct Compressed {
    bool finite = false;
    double size = 0;         ///< norm of the residuals
    Eigen::MatrixXd factor;  ///< upper triangle; the residuals are its last column
  };

  const SimulationError& problem_;
  const Model& model_;
  const Free& free_;
  const Robust robust_;
  const int threads_;
  std::vector<double>& scaled_;
  Initials& initial_;
  std::vector<Compressed> windows_;
  bool has_derivatives_ = false;
};

/// J'WJ and J'r.
struct NormalEquations {
  Eigen::MatrixXd A;
  Eigen::VectorXd b;
};
/// Of the rows [first, last) and the first `columns` columns of J, W being a diagonal.
NormalEquations normalEquations(const Derivatives& rows, int columns, const Eigen::VectorXd& weight,
                                const Eigen::VectorXd& residual, Eigen::Index first,
                                Eigen::Index last);

}  // namespace ground
