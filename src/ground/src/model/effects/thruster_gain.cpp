#include "ground/model/effect_registry.h"

namespace ground {

/// One thruster weaker or stronger than the others: F (1 + a).
struct ThrusterGain {
  static constexpr Effect::Hook kHook = Effect::kThrust;

  static EffectInfo info() {
    return {"thruster_gain",
            "weak or strong thruster",
            {{"a", "-", "relative change of its thrust", 0, -1, 1, [](const Body<double>&) { return 0.1; }}}};
  }
  template <typename T>
  static void act(const T* p, const Point<T>&, int thruster, Thrusters<T>& force) {
    force(thruster) *= 1.0 + p[0];
  }
};
GROUND_REGISTER_THRUSTER_EFFECT(ThrusterGain)

}  // namespace ground
