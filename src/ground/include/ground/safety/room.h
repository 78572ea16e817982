#pragma once

#include <string>
#include <vector>

#include "ground/model/types.h"

namespace ground {

/// The allowed floor area, world_ned, and the braking of a craft on it; by default 4 x 4 m about
/// the origin.
struct Room {
  std::string name;
  /// Corners of a simple polygon, in order [m].
  std::vector<Vector2<double>> corners = {{-2, -2}, {2, -2}, {2, 2}, {-2, 2}};
  double margin = 0.2;            ///< controllers keep this distance from the walls [m]
  Vector2<double> home = {0, 0};  ///< where bursts of excitation begin [m]
  double braking = 1.5;           ///< smallest deceleration by the floor of a craft without lift [m/s^2]
  double latency = 0.1;           ///< time from a state until the motors are off [s]

  std::string validate() const;  ///< error message; empty if all values are valid

  /// Distance of a point from the nearest wall [m], negative outside; `away`: its gradient, the
  /// unit vector away from that wall or, outside, towards it.
  double clearance(const Vector2<double>& point, Vector2<double>& away) const;
  double clearance(const Vector2<double>& point) const;
  /// The smallest clearance on the straight line between two points [m], within 5 mm.
  double clearanceOfWay(const Vector2<double>& from, const Vector2<double>& to) const;
};

/// Reads a room file, schema ground/room/1. Throws std::runtime_error that names file, line and
/// key.
Room loadRoom(const std::string& path);
/// Like loadRoom from YAML text; `source` names it in messages.
Room parseRoom(const std::string& yaml, const std::string& source);

}  // namespace ground
