#pragma once

#include <random>

#include "ground/model/disturbance.h"

namespace ground {

/// A realisation of a disturbance in one run: a wrench that is constant over each step, and a
/// factor on the thrust. The Ornstein-Uhlenbeck process is discretised exactly and starts
/// stationary; white noise is averaged over a step. The same seed gives the same numbers.
class DisturbanceSource {
 public:
  /// Steps are `step` [s] long. Throws std::invalid_argument on a bad disturbance.
  DisturbanceSource(const Disturbance& disturbance, double step, unsigned long seed);

  /// The wrench over the next step: X, Y [N], N [N m], body.
  Vector3<double> next();
  /// Factor on the thrust of this run, positive.
  double thrustFactor() const { return thrust_factor_; }

 private:
  Vector3<double> draw();  ///< three independent standard normal numbers

  std::mt19937_64 random_;
  std::normal_distribution<double> normal_;
  Vector3<double> keep_;            ///< fraction of the process that remains after a step
  Vector3<double> drive_, white_;   ///< deviation of the random change per step [N, N, N m]
  Vector3<double> trim_, process_;  ///< [N, N, N m]; the process at the next step
  double thrust_factor_;
};

}  // namespace ground
