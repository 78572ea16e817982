#include <cmath>

#include "ground/model/effect_registry.h"

namespace ground {

/// A foil behind a hull with one propeller meets more of the sway of one side than of the other, by the twist
/// of the stream: own_sway times 1 + a for flow from port, 1 - a from starboard (gamma_R of Yasukawa and
/// Yoshimura 2015).
struct FoilSide {
  static constexpr Effect::Hook kHook = Effect::kSteer;

  static EffectInfo info() {
    const auto tenth = [](const Body<double>&) { return 0.1; };
    return EffectInfo{"foil_side",
                      "flow that differs between both sides of foil",
                      {{"a", "-", "relative part of own_sway, more from port", 0, -1, 1, tenth}}}
        .of(Surroundings::kWater);
  }
  static bool suits(const ThrusterLayout& layout, int channel) {
    const Thruster& one = layout[channel];
    return one.kind == Thruster::Kind::kFoil && !one.foil.stream.empty() && one.foil.own_sway != 0;
  }
  template <typename T>
  static void act(const T* p, Steered<T>& foil) {
    foil.own_side += p[0];
  }
};
GROUND_REGISTER_THRUSTER_EFFECT(FoilSide)

}  // namespace ground
