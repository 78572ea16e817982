// Uncertainty of fitted parameters.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "descent.h"
#include "linearisation.h"

namespace ground::detail {

/// Uncertainty of the free parameters, in scaled coordinates.
struct Uncertainty {
  Eigen::MatrixXd information, covariance;
  std::vector<bool> identified;  ///< false: not identifiable from the data, infinite variance
  Eigen::MatrixXd unseen;        ///< columns: directions along which the cost does not change
  int blocks = 0;
};

/// Jackknife over blocks of about `block` seconds, within which residuals may be correlated: each
/// block is left out once, and one Newton step gives the estimate without it, initial states
/// included. Unlike the sum of squared scores it is not biased by residuals that the fit has
/// reduced (MacKinnon and White 1985, HC3).
Uncertainty uncertainty(Linearisation& windows, const Free& free, const Solution& at, double block);

/// Robust standard deviation from the median of |residuals|; 0 if there are none.
double deviationOf(std::vector<double> residuals);

}  // namespace ground::detail
