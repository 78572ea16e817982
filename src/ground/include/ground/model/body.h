#pragma once

#include <Eigen/Core>
#include <cmath>

namespace ground {

/// Nominal parameters of a craft (thesis 3.1): rigid body, linear damping, linear thrust.
template <typename T>
struct Body {
  T m{};    ///< mass [kg]
  T l{};    ///< lever arm of the thrusters [m]
  T I_z{};  ///< moment of inertia about the centre of mass [kg m^2]
  T X_u{};  ///< surge damping [N s/m]
  T Y_v{};  ///< sway damping [N s/m]
  T N_r{};  ///< yaw damping [N m s]
  T k{};    ///< thrust of one thruster per unit input [N]

  /// Largest input of a thruster: 1 where inputs are normalised.
  double input_max = 1.0;
  /// Length of the hull of a craft on water [m]; 0: it is not on water.
  double hull_length = 0.0;
  /// Voltage of the battery at which k holds [V]; 0: not told.
  double volts = 0.0;

  /// Half the length of the hull [m]; without one, of a bar with the craft's radius of gyration.
  T halfHull() const {
    using std::sqrt;
    return hull_length > 0 ? T(0.5 * hull_length) : T(sqrt(3.0 * I_z / m));
  }
};

/// A load of known mass that a craft carries beside its own.
struct Payload {
  double mass = 0;                 ///< [kg]
  Eigen::Vector2d place = {0, 0};  ///< of its centre of mass: forward, to starboard [m]
  double inertia = 0;              ///< about its own centre of mass [kg m^2]

  bool empty() const { return mass == 0 && inertia == 0; }
};

}  // namespace ground
