// How well a fit knows its parameters.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "descent.h"
#include "linearisation.h"

namespace ground::detail {

/// How well the free parameters are known, in scaled coordinates.
struct Uncertainty {
  Eigen::MatrixXd information, covariance;
  std::vector<bool> identified;  ///< false: the data say nothing, the variance is infinite
  Eigen::MatrixXd unseen;        ///< columns: directions along which the cost does not change
  int blocks = 0;
};

/// Jackknife over blocks of about `block` seconds, inside which residuals may be correlated: each
/// block is left out once, and one Newton step says where the estimate, the initial states with it,
/// would go. Unlike the sum of squared scores it is not fooled by residuals that the fit has made
/// small (MacKinnon and White 1985, HC3).
Uncertainty uncertainty(Linearisation& windows, const Free& free, const Solution& at, double block);

/// Standard deviation that the median of the residuals' sizes stands for; 0 without any.
double deviationOf(std::vector<double> residuals);

}  // namespace ground::detail
