#include "ground/model/effect_registry.h"

namespace ground {

/// Unequal thrusters: k_L = k (1 + a), k_R = k (1 - a).
struct ThrustAsymmetry {
  static constexpr bool kUsesPose = false;

  static EffectInfo info() {
    return {"thrust_asymmetry",
            "left thruster stronger than the right",
            {{"a", "-", "relative difference", 0, -1, 1, [](const Body<double>&) { return 0.1; }}}};
  }
  template <typename T>
  static void thrust(const T* p, const Point<T>&, Vector2<T>& force) {
    force(0) *= 1.0 + p[0];
    force(1) *= 1.0 - p[0];
  }
};
GROUND_REGISTER_EFFECT(ThrustAsymmetry)

}  // namespace ground
