// What makes pose errors of a window independent of each other.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "ground/identification/simulation_error.h"

namespace ground {

/// Divides each pose error of a window by its standard deviation given those before it. The errors
/// are taken as noise of the poses plus what a white acceleration, unknown to the model, moves the
/// craft by: x, y and psi each drift as a twice integrated white noise, so that a Kalman filter for
/// each, its gains known beforehand, foretells the next error from the last ones (innovations,
/// Ljung 1999, 7.2). Without the acceleration it divides by the noise.
class Whitening {
 public:
  Whitening(const std::vector<double>& times, int first, int last, const Vector3<double>& noise,
            const Vector3<double>& disturbance);

  /// In place; rows are x, y, psi of one sample after the other.
  void apply(Eigen::VectorXd& errors) const;
  /// The same to derivatives of errors, eight columns at once.
  void apply(Derivatives& columns) const;

  /// Standard deviation of x, y, psi at each sample given those before.
  const std::vector<Vector3<double>>& deviations() const { return deviation_; }

 private:
  template <typename V>
  void filter(double* rows, Eigen::Index stride) const;

  std::vector<Vector3<double>> deviation_, gain_position_, gain_rate_;
  std::vector<double> step_;  ///< to the next sample [s]
  bool white_;
};

}  // namespace ground
