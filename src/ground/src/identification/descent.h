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

/// Relative change of the cost at which a descent ends: for an approximate solution, and for a
/// descent that is followed by a finer one.
constexpr double kApproachTolerance = 0.1, kCoarseTolerance = 1e-5;

/// Widths of the losses to descend by, one after the other. Least squares come first because they
/// have the widest basin of attraction; smaller widths approach absolute values.
std::vector<double> lossesOf(FitOptions::Objective objective);

/// End of a descent.
struct Solution {
  std::vector<double> scaled;  ///< free parameters, in coordinates over scale
  Initials initial;
  double delta = kInfinity;  ///< width of the last loss
  double cost = kInfinity;   ///< half the sum of the losses
  int iterations = 0;
  bool usable = false, converged = false;
  std::string message;  ///< message of the solver
};

/// Descends from `scaled` by one loss after the other. The last loss ends at the fine tolerance
/// unless it is least squares; all others end at `coarse`.
Solution descend(Linearisation& windows, const Free& free, const std::vector<double>& losses,
                 const FitOptions& options, std::vector<double> scaled, Initials initial,
                 double coarse = kCoarseTolerance);

/// Moves a solution back to its start along directions that are not identifiable (columns of
/// `unseen`), along which a descent may have moved any distance. For each such direction, the
/// parameter that changes most along it is fixed at its start, and the other parameters are fitted
/// again. Returns `found` if this raises the cost by more than 1%, which means that the data rule
/// out the start.
Solution startKept(Linearisation& windows, const Free& free, const Eigen::MatrixXd& unseen,
                   const FitOptions& options, const Solution& found);

}  // namespace ground::detail
