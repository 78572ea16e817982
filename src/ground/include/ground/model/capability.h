#pragma once

#include "ground/model/model.h"

namespace ground {

/// What the thrusters of a craft at rest can do at most, at the voltage at which k holds. Monitors, time
/// scales and plausibility take it from here.
struct Capability {
  Vector3<double> wrench;  ///< largest |X|, |Y| [N], |N| [N m], each by inputs of its own
  double force;            ///< in the direction in which it is strongest, without angles [N]

  /// Largest accelerations of a craft of this mass [kg] and inertia [kg m^2], in the strongest direction
  /// [m/s^2] and in yaw [rad/s^2].
  Vector2<double> accelerations(double m, double I_z) const { return {force / m, wrench.z() / I_z}; }
};

Capability capability(const ThrusterLayout& layout, const Body<double>& body);
inline Capability capability(const Model& model) { return capability(*model.thrusters, model.body); }

}  // namespace ground
