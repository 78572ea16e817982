// Descent of the windows' cost in free parameters and initial states.
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "free_parameters.h"
#include "initial_states.h"
#include "linearisation.h"
#include "robust_loss.h"

namespace ground::detail {

/// Relative change of the cost at which a descent ends: one that only has to come near, and one
/// that another follows.
constexpr double kApproachTolerance = 5e-2, kCoarseTolerance = 1e-5;

/// Widths of the losses to descend by, one after the other. Least squares come first, they have the
/// widest basin; absolute values are approached from them.
std::vector<double> lossesOf(FitOptions::Objective objective);

/// Where a descent ended.
struct Solution {
  std::vector<double> scaled;  ///< free parameters, in coordinates over scale
  Initials initial;
  double delta = kInfinity;  ///< width of the last loss
  double cost = kInfinity;   ///< half the sum of the losses
  int iterations = 0;
  bool usable = false, converged = false;
  std::string message;  ///< of the solver
};

/// Descends from `scaled` by one loss after the other, to the fine tolerance by the last, to
/// `coarse` by those before and by least squares.
Solution descend(Linearisation& windows, const Free& free, const std::vector<double>& losses,
                 const FitOptions& options, std::vector<double> scaled, Initials initial,
                 double coarse = kCoarseTolerance);

/// The same fit with its start along directions that the data do not see (columns of `unseen`): on
/// its way a descent may have gone any length along them. As many parameters as there are such
/// directions, those that move most along them, are put back to their start, and the others are
/// fitted beside them. Returns what was found where that raises the cost: the data do rule the
/// start out.
Solution startKept(Linearisation& windows, const Free& free, const Eigen::MatrixXd& unseen,
                   const FitOptions& options, const Solution& found);

}  // namespace ground::detail
