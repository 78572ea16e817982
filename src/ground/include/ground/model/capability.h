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

/// Time [s] in which full thrust moves a craft by some lengths or turns it round: 1 s for a palm-sized
/// hovercraft, 10 s for a free-flyer. It is rounded, so that models of a craft have the same.
double timeScale(const Model& model);

/// The nearest of 1, 2 and 5 times a power of ten; seconds must be positive.
double roundedTime(double seconds);

}  // namespace ground
