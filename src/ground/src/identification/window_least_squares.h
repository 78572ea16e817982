// Least squares over windows: free parameters, and the initial state of each window.
#pragma once

#include <vector>

#include "free_parameters.h"
#include "linearisation.h"
#include "robust_loss.h"

namespace ground::detail {

/// Relative change of the cost at which a fit ends: of an approximate solution, of one that a finer fit
/// follows, of comparisons (FitOptions::warm), of a result.
constexpr double kApproximate = 0.1, kCoarse = 1e-3, kComparable = 1e-6, kFine = 1e-6;

/// Widths of the losses to minimise, one after the other. Least squares come first because they have the
/// widest basin of attraction; smaller widths approach absolute values.
std::vector<double> lossesOf(FitOptions::Objective objective);

/// Parameters and initial states at a minimum.
struct Solution {
  std::vector<double> scaled;  ///< free parameters, in coordinates over scale
  Initials initial;
  double delta = kInfinity;  ///< width of the loss
  double cost = kInfinity;   ///< half the sum of the losses; not finite if the start cannot be simulated
  int iterations = 0;        ///< in all
  bool converged = false;
};

/// Minimises the loss of width `delta` from a solution, to a relative change of `tolerance`.
Solution minimiseLoss(const Linearisation& windows, const Free& free, double delta, double tolerance,
                      int max_iterations, const Solution& from);

/// Moves a solution back to its start along directions that are not identifiable (columns of
/// `null_space`), along which a fit may have moved any distance. For each such direction, the
/// parameter that changes most along it is fixed at its start, and the other parameters are fitted
/// again. Returns `found` if this raises the cost by more than 1%, which means that the data rule
/// out the start.
Solution restoreUnidentifiable(const Linearisation& windows, const Free& free,
                               const Eigen::MatrixXd& null_space, double tolerance, int max_iterations,
                               const Solution& found);

}  // namespace ground::detail
