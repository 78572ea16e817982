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

}  // namespace ground
