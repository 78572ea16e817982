#include "ground/model/effect_registry.h"

namespace ground {

/// A thruster that turns farther than its commands say, or less. A foil has foil_gain instead, which small
/// angles cannot distinguish from this.
struct AngleGain {
  static constexpr Effect::Hook kHook = Effect::kSteer;

  static EffectInfo info() {
    return {"angle_gain",
            "angle that turns too far or too little,",
            {{"a", "-", "relative change of its angle", 0, -1, 1, [](const Body<double>&) { return 0.1; }}}};
  }
  static bool suits(const ThrusterLayout& layout, int channel) {
    return layout[channel].kind == Thruster::Kind::kTurn;
  }
  template <typename T>
  static void act(const T* p, Steered<T>& angle) {
    angle.scale *= 1.0 + p[0];
  }
};
GROUND_REGISTER_THRUSTER_EFFECT(AngleGain)

}  // namespace ground
