#include "approach.h"
#include "ground/model/effect_registry.h"

namespace ground {

/// First-order lag of a rudder or of a turning thruster.
struct AngleLag {
  static constexpr Effect::Hook kHook = Effect::kActuate;

  static EffectInfo info() {
    return {"angle_lag",
            "first-order lag of the angle of",
            {{"tau", "s", "time constant", 0, 0, 20, [](const Body<double>&) { return 0.05; }}},
            1};
  }
  static bool suits(const ThrusterLayout& layout, int channel) { return !layout.pushes(channel); }
  template <typename T>
  static void act(const T* p, const T& h, T* states, int channel, StepInputs<T>& inputs) {
    approach(commanded(inputs, channel), decay(p[0], h), channel, states[0], inputs);
  }
};
GROUND_REGISTER_THRUSTER_EFFECT(AngleLag)

}  // namespace ground
