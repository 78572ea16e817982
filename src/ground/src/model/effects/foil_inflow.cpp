#include "ground/model/effect_registry.h"

namespace ground {

/// How much of the craft's own motion reaches a foil, beside the stream of its thruster: a hull's wake slows
/// the flow, and straightens it. Changes own_speed^2 by `speed` and own_sway by `sway`.
struct FoilInflow {
  static constexpr Effect::Hook kHook = Effect::kSteer;

  static EffectInfo info() {
    const auto tenth = [](const Body<double>&) { return 0.1; };
    return {"foil_inflow",
            "more or less of the craft's own motion at foil",
            {{"speed", "-", "added to the square of own_speed", 0, -4, 4, tenth},
             {"sway", "-", "added to own_sway", 0, -2, 2, tenth}}};
  }
  static bool suits(const ThrusterLayout& layout, int channel) {
    return layout[channel].kind == Thruster::Kind::kFoil;
  }
  template <typename T>
  static void act(const T* p, Steered<T>& foil) {
    foil.own_square += p[0];
    foil.own_sway += p[1];
  }
};
GROUND_REGISTER_THRUSTER_EFFECT(FoilInflow)

}  // namespace ground
