// Normal equations of windows' residuals under a loss.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <vector>

#include "ground/identification/simulation_error.h"
#include "ground/model/lanes.h"

namespace ground {

/// What a loss makes of each of `count` residuals: weight W and product s of J'WJ and J's, and the
/// loss itself, twice what the cost grows by. Without `weight` only the loss is asked for.
using Weigh = std::function<void(const double* residuals, int count, double* weight,
                                 double* product, double* loss)>;

/// J'WJ, J's and the loss.
struct NormalEquations {
  Eigen::MatrixXd A;
  Eigen::VectorXd b;
  double loss = 0;
};

/// Residuals and derivatives of windows side by side: three rows a visit.
struct LaneRows {
  std::vector<Lanes> residuals;
  std::vector<Lanes> derivatives;  ///< `stride` of each residual: the columns, then zeros
  int stride = 0;

  /// Made for so many rows; derivatives beyond the columns are zero.
  void prepare(int rows, int columns);
};

/// Of the rows [first, last) and the first `columns` columns of J.
NormalEquations normalEquations(const WindowResiduals& rows, int columns, int first, int last,
                                const Weigh& weigh);

/// Of rows of several windows, added up.
class LaneSums {
 public:
  explicit LaneSums(int columns);
  void add(const LaneRows& rows, int first, int last, const Weigh& weigh);
  /// Takes the sums of one lane out, which are zero then.
  void take(int lane, NormalEquations& result);

 private:
  int columns_, blocks_;
  std::vector<Lanes> A_;  ///< blocks on and above the diagonal
  std::vector<Lanes> b_;
  Lanes loss_ = 0.0;
};

/// Losses of the lanes.
Lanes losses(const std::vector<Lanes>& residuals, const Weigh& weigh);

}  // namespace ground
