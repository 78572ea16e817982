#pragma once

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
  /// Voltage of the battery at which k holds [V]; 0: not told.
  double volts = 0.0;
};

}  // namespace ground
