#include "ground/model/effect_registry.h"

namespace ground {

/// A rudder or vane whose force is smaller or larger than the model has it: c (1 + a).
struct FoilGain {
  static constexpr Effect::Hook kHook = Effect::kSteer;

  static EffectInfo info() {
    return {"foil_gain",
            "weak or strong foil",
            {{"a", "-", "relative change of its force", 0, -1, 20, [](const Body<double>&) { return 0.1; }}}};
  }
  static bool suits(const ThrusterLayout& layout, int channel) {
    return layout[channel].kind == Thruster::Kind::kFoil;
  }
  template <typename T>
  static void act(const T* p, Steered<T>& foil) {
    foil.force *= 1.0 + p[0];
  }
};
GROUND_REGISTER_THRUSTER_EFFECT(FoilGain)

}  // namespace ground
