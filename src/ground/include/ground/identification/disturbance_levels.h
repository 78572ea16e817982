#pragma once

#include <array>
#include <string>

#include "ground/model/body.h"
#include "ground/model/types.h"

namespace ground {

/// Levels (standard deviations and correlation times) of everything random in recordings: the
/// wrench that disturbs the craft (body frame; channels X, Y [N], N [N m]), the force that disturbs
/// it along the axes of the room (world_ned), the trims that differ from run to run, and the noise
/// of the poses.
struct DisturbanceLevels {
  /// Stationary standard deviation of the Ornstein-Uhlenbeck wrench [N], [N m].
  Vector3<double> sigma = Vector3<double>::Zero();
  Vector3<double> time = Vector3<double>::Ones();  ///< its correlation time [s]
  /// Stationary standard deviation of each component of the Ornstein-Uhlenbeck force that keeps its
  /// direction in the room [N].
  double sigma_room = 0;
  double time_room = 1;  ///< its correlation time [s]
  /// Root of the density of the white wrench [N sqrt(s)], [N m sqrt(s)].
  Vector3<double> white = Vector3<double>::Zero();
  double position = 1, heading = 1;                ///< pose noise, relative to RunData::noise
  Vector3<double> trim = Vector3<double>::Zero();  ///< deviation of the constant wrench of a run
  double thrust = 0;  ///< deviation of the constant relative change of thrust of a run

  static constexpr int kCount = 17;
  /// sigma X, Y, N, room, time X, Y, N, room, white X, Y, N, position, heading, trim X, Y, N, thrust.
  std::array<double, kCount> values() const;
  static DisturbanceLevels of(const std::array<double, kCount>& values);
  static const std::array<std::string, kCount>& names();
};

/// Prior of the levels: each is log-normal. The priors are broad, except for the pose noise, which
/// the recording determines within a factor of about 1.5.
struct LevelPrior {
  DisturbanceLevels median;
  std::array<double, DisturbanceLevels::kCount> deviation;  ///< standard deviations of logarithms

  explicit LevelPrior(const Body<double>& body);
};

}  // namespace ground
