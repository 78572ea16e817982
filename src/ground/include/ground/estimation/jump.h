#pragma once

#include <cmath>

#include "ground/model/dynamics.h"

namespace ground {

/// How far from where it was going a craft is found again.
struct Jump {
  double way;   ///< [m]
  double turn;  ///< [rad]
  double dt;    ///< [s]

  Jump(const RigidState<double>& from, const RigidState<double>& to, double gap) : dt(gap) {
    const Vector2<double> over_floor = bodyToWorld<double>(from.eta.z(), from.nu.head<2>().eval());
    way = (to.eta.head<2>() - from.eta.head<2>() - over_floor * dt).norm();
    turn = std::abs(wrapAngle(to.eta.z() - from.eta.z() - from.nu.z() * dt));
  }
  /// Whether thrust and drag cannot have done it: it has been carried, or the mocap sees something
  /// else. Much closer than sameMotion(), which knows no velocity.
  bool impossible() const {
    constexpr double kWay = 0.2, kSpeed = 2.0;     // at once, and more with time [m], [m/s]
    constexpr double kTurn = 0.6, kTurnRate = 10;  // [rad], [rad/s]
    return way > kWay + kSpeed * dt || turn > kTurn + kTurnRate * dt;
  }
};

}  // namespace ground
