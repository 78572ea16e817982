#pragma once

#include <cmath>

#include "ground/model/dynamics.h"

namespace ground {

/// Difference between a craft's pose after a gap and the pose expected at constant velocity.
struct Jump {
  double way;   ///< distance [m]
  double turn;  ///< heading difference [rad]
  double dt;    ///< length of the gap [s]

  Jump(const RigidState<double>& from, const RigidState<double>& to, double gap) : dt(gap) {
    const Vector2<double> over_floor = bodyToWorld<double>(from.eta.z(), from.nu.head<2>().eval());
    way = (to.eta.head<2>() - from.eta.head<2>() - over_floor * dt).norm();
    turn = std::abs(wrapAngle(to.eta.z() - from.eta.z() - from.nu.z() * dt));
  }
  /// Whether thrust and drag cannot explain the jump: the craft was carried, or the mocap tracks
  /// something else. Stricter than sameMotion(), which does not use the velocity.
  bool impossible() const {
    // Limit for a short gap, and its increase with time.
    constexpr double kWay = 0.2, kSpeed = 2.0;     // [m], [m/s]
    constexpr double kTurn = 0.6, kTurnRate = 10;  // [rad], [rad/s]
    return way > kWay + kSpeed * dt || turn > kTurn + kTurnRate * dt;
  }
};

}  // namespace ground
