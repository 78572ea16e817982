// Uncertainty of fitted parameters.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "estimates.h"
#include "linearisation.h"
#include "window_least_squares.h"

namespace ground::detail {

/// Uncertainty of the free parameters, in coordinates over scale.
struct Uncertainty {
  Eigen::MatrixXd information, covariance;
  Identifiable known;  ///< by the information
  int blocks = 0;
  /// What a shift of the mean of each prior by its deviation does to the estimates, (n, n).
  Eigen::MatrixXd shifts;

  Eigen::VectorXd deviation() const;  ///< standard deviations; infinite if not identifiable
};

/// Jackknife over blocks of about a third of a window (RunScales), within which residuals may be correlated:
/// each block is left out once, and one Newton step gives the estimate without it, initial states included.
/// Unlike the sum of squared scores it is not biased by residuals that the fit has reduced (MacKinnon and
/// White 1985, HC3). What is known beforehand adds its own variance.
Uncertainty uncertainty(const Linearisation& windows, const Free& free, const Solution& at);

/// By how much the variance of estimates from windows alone exceeds the inverse of their information, on
/// average: tr(H V) / n. A prior of this weight counts as much as data that determine parameters as well.
double magnitudeOf(const Linearisation& windows, Free free, const Solution& at);

/// Correlation of the estimates, (n, n).
Eigen::MatrixXd correlationOf(const Uncertainty& u, const Free& free);

/// Condition number of the information; infinite if it is singular.
double conditionOf(const Uncertainty& u);

/// Robust standard deviation from the median of |residuals|; 0 if there are none.
double deviationOf(std::vector<double> residuals);

}  // namespace ground::detail
