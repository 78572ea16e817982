#include <cmath>

#include "ground/model/effect_registry.h"

namespace ground {

/// A rudder or a turning thruster whose zero is elsewhere than the model has it.
struct AngleOffset {
  static constexpr Effect::Hook kHook = Effect::kSteer;

  static EffectInfo info() {
    return {
        "angle_offset",
        "wrong zero of the angle of",
        {{"angle", "rad", "added to its angle", 0, -M_PI, M_PI, [](const Body<double>&) { return 0.1; }}}};
  }
  static bool suits(const ThrusterLayout& layout, int channel) { return !layout.pushes(channel); }
  template <typename T>
  static void act(const T* p, Steered<T>& angle) {
    angle.offset += p[0];
  }
};
GROUND_REGISTER_THRUSTER_EFFECT(AngleOffset)

}  // namespace ground
