// The mass matrix.
#include "ground/model/effect_registry.h"

namespace ground {

/// Air or water that has to be accelerated with the craft: m_x = m + mx, m_y = m + my, with the Coriolis
/// terms and the Munk moment that follow (Fossen 1994, 2.4).
struct AddedMass {
  static EffectInfo info() {
    const auto scale = [](const Body<double>& b) { return 0.1 * b.m; };
    return {"added_mass",
            "air or water accelerated with the craft",
            {{"mx", "kg", "in surge", 0, 0, kUnbounded, scale},
             {"my", "kg", "in sway", 0, 0, kUnbounded, scale}}};
  }
  template <typename T>
  static void inertia(const T* p, const Body<T>&, Matrix3<T>& mass) {
    mass(0, 0) += p[0];
    mass(1, 1) += p[1];
  }
};
GROUND_REGISTER_EFFECT(AddedMass)

/// Centre of mass at (xg, yg) from the point half-way between the thrusters, which stays the origin
/// of the body frame (Fossen 1994, 2.4). I_z remains the inertia about the centre of mass.
struct ComOffset {
  static EffectInfo info() {
    const auto scale = [](const Body<double>& b) { return 0.1 * b.l; };
    return {"com_offset",
            "centre of mass off the thrust axis",
            {{"xg", "m", "forward", 0, -kUnbounded, kUnbounded, scale},
             {"yg", "m", "to starboard", 0, -kUnbounded, kUnbounded, scale}}};
  }
  template <typename T>
  static void inertia(const T* p, const Body<T>& body, Matrix3<T>& mass) {
    const T x = body.m * p[0], y = body.m * p[1];
    mass(0, 2) -= y;
    mass(2, 0) -= y;
    mass(1, 2) += x;
    mass(2, 1) += x;
    mass(2, 2) += x * p[0] + y * p[1];
  }
};
GROUND_REGISTER_EFFECT(ComOffset)

}  // namespace ground
