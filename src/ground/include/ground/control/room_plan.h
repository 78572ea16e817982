#pragma once

#include <string>
#include <vector>

#include "ground/model/types.h"

namespace ground {

/// The floor that a craft may be on, world_ned, and how it stops there; by default 4 x 4 m about the
/// origin.
struct RoomPlan {
  std::string name;
  /// They make a simple polygon, in order [m].
  std::vector<Vector2<double>> corners = {{-2, -2}, {2, -2}, {2, 2}, {-2, 2}};
  double margin = 0.2;                   ///< controllers keep this distance from the walls [m]
  Vector2<double> home = {0, 0};         ///< where bursts of excitation begin [m]
  double braking = 1.5;  ///< least deceleration by the floor of a craft without lift [m/s^2]
  double latency = 0.1;  ///< from a state to motors that are off [s]

  std::string validate() const;  ///< what is wrong; empty when nothing is

  /// Distance of a point from the nearest wall [m], negative outside; `away`: its gradient, the unit
  /// vector away from that wall or, outside, towards it.
  double clearance(const Vector2<double>& point, Vector2<double>& away) const;
  double clearance(const Vector2<double>& point) const;
  /// The least clearance on the straight way from one point to another [m]. Exact to 5 mm.
  double clearanceOfWay(const Vector2<double>& from, const Vector2<double>& to) const;
};

/// Reads a room file, schema ground/room/1. Throws std::runtime_error that names file, line and key.
RoomPlan loadRoomPlan(const std::string& path);
/// The same from YAML text; `source` names it in messages.
RoomPlan parseRoomPlan(const std::string& yaml, const std::string& source);

}  // namespace ground
