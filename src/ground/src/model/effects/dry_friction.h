// Shared by the effects of dry friction.
#pragma once

#include <cmath>

#include "ground/model/effect.h"

namespace ground {

constexpr double kSlow = 0.01;    ///< speed below which friction is proportional to it [m/s]
constexpr double kSlowYaw = 0.1;  ///< yaw rate below which the moment is proportional to it [rad/s]

/// Sign of x, smooth at zero: x / sqrt(x^2 + slow^2).
template <typename T>
T smoothSign(const T& x, double slow) {
  using std::sqrt;
  return x / sqrt(x * x + slow * slow);
}

/// Adds a force [N] against the velocity over the floor and a moment [N m] against the yaw rate.
/// Both are constant except for a smooth transition through zero.
template <typename T>
void addDryFriction(const Point<T>& point, const T& force, const T& moment, Vector3<T>& wrench) {
  using std::sqrt;
  const T &u = point.nu.x(), &v = point.nu.y();
  const T per_speed = force / sqrt(u * u + v * v + kSlow * kSlow);
  wrench(0) -= per_speed * u;
  wrench(1) -= per_speed * v;
  wrench(2) -= moment * smoothSign(point.nu.z(), kSlowYaw);
}

}  // namespace ground
