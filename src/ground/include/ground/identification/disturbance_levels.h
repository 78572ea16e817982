#pragma once

#include <array>
#include <string>

#include "ground/model/body.h"
#include "ground/model/types.h"

namespace ground {

/// How strong all that is random about recordings is: the wrench that disturbs the craft (body
/// frame; channels X, Y [N], N [N m]), what differs from run to run, and the poses' noise.
struct DisturbanceLevels {
  Vector3<double> sigma = Vector3<double>::Zero();  ///< of the Ornstein-Uhlenbeck wrench, stationary
  Vector3<double> time = Vector3<double>::Ones();   ///< its correlation time [s]
  Vector3<double> white = Vector3<double>::Zero();  ///< of the white wrench [N sqrt(s), N m sqrt(s)]
  double position = 1, heading = 1;  ///< of the poses' noise, in parts of that of the recording
  Vector3<double> trim = Vector3<double>::Zero();  ///< of the wrench that is constant in a run
  double thrust = 0;  ///< of the relative change of all thrust that is constant in a run

  static constexpr int kCount = 15;
  /// sigma X, Y, N, time X, Y, N, white X, Y, N, position, heading, trim X, Y, N, thrust.
  std::array<double, kCount> values() const;
  static DisturbanceLevels of(const std::array<double, kCount>& values);
  static const std::array<std::string, kCount>& names();
};

/// What is known of the levels before any data: each is log-normal, broad but for the poses' noise,
/// which the recording itself tells within a factor of about 1.5.
struct LevelPrior {
  DisturbanceLevels median;
  std::array<double, DisturbanceLevels::kCount> deviation;  ///< of the logarithms

  explicit LevelPrior(const Body<double>& body);
};

}  // namespace ground
