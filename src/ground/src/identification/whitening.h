// What makes the errors of a window independent of each other.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cmath>
#include <vector>

#include "ground/model/lanes.h"
#include "ground/model/types.h"

namespace ground {

/// Divides each error of a window by its standard deviation given those before it. V: double for
/// one window, Lanes for eight side by side.
template <typename V>
struct Whitening {
  /// What an error says about the next ones.
  struct Foresight {
    std::array<V, 3> gain_position, gain_rate;
    V step;  ///< to the next sample [s]
  };

  std::vector<std::array<V, 3>> over_deviation;  ///< of each sample
  std::vector<Foresight> foresight;  ///< of each sample, or none: errors are independent
};

/// Errors are independent of each other as they are.
Whitening<double> independentErrors(std::size_t samples, const Vector3<double>& deviation);

/// Errors of poses: noise plus what a white acceleration, unknown to the model, moves the craft by.
/// x, y and psi each drift as a twice integrated white noise, so that a Kalman filter for each, its
/// gains known beforehand, foretells the next error from the last ones (innovations, Ljung 1999,
/// 7.2). Without the acceleration it divides by the noise.
Whitening<double> driftingErrors(const std::vector<double>& times, int first, int last,
                                 const Vector3<double>& noise, const Vector3<double>& disturbance);

/// Whitens one error after the other, or the derivatives of errors. R: double or Lanes.
template <typename V, typename R>
class Innovations {
 public:
  explicit Innovations(const Whitening<V>& whitening) : whitening_(&whitening) {}

  GROUND_INLINE void apply(int sample, int c, R& error) {
    const V& over_deviation = whitening_->over_deviation[sample][c];
    if (whitening_->foresight.empty()) {
      error *= over_deviation;
      return;
    }
    const typename Whitening<V>::Foresight& now = whitening_->foresight[sample];
    const R innovation = error - drift_[c];
    error = innovation * over_deviation;
    rate_[c] += now.gain_rate[c] * innovation;
    drift_[c] += now.gain_position[c] * innovation + now.step * rate_[c];
  }

 private:
  const Whitening<V>* whitening_;
  R drift_[3] = {0.0, 0.0, 0.0}, rate_[3] = {0.0, 0.0, 0.0};
};

}  // namespace ground
