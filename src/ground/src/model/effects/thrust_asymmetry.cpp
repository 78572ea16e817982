#include "ground/model/effect_registry.h"

namespace ground {

/// Unequal thrusters: k_L = k (1 + a), k_R = k (1 - a). On crafts with other thrusters, those that
/// turn it clockwise seen from above have k (1 + a), those that turn it the other way k (1 - a).
struct ThrustAsymmetry {
  static constexpr bool kUsesPose = false;

  static EffectInfo info() {
    return {"thrust_asymmetry",
            "unequal left and right thrusters",
            {{"a", "-", "relative difference", 0, -1, 1, [](const Body<double>&) { return 0.1; }}}};
  }
  template <typename T>
  static void thrust(const T* p, const Point<T>& point, Thrusters<T>& force) {
    for (int i = 0; i < force.size(); ++i) {
      const double lever = point.layout.lever(i);
      if (lever > 0) force(i) *= 1.0 + p[0];
      if (lever < 0) force(i) *= 1.0 - p[0];
    }
  }
};
GROUND_REGISTER_EFFECT(ThrustAsymmetry)

}  // namespace ground
