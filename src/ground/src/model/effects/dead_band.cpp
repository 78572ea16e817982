#include <cmath>

#include "ground/model/effect_registry.h"

namespace ground {

/// A channel that does not answer small commands: u - sign(u) width beyond the width, else 0.
struct DeadBand {
  static constexpr Effect::Hook kHook = Effect::kActuate;

  static EffectInfo info() {
    return {"dead_band",
            "dead band of",
            {{"width", "-", "input without effect", 0, 0, 1, [](const Body<double>&) { return 0.05; }}}};
  }
  static bool suits(const ThrusterLayout& layout, int) { return layout.steers(); }
  template <typename T>
  static void act(const T* p, const T&, T*, int channel, StepInputs<T>& inputs) {
    using std::abs;
    for (Thrusters<T>& node : inputs.thrusters) {
      T& u = node(channel);
      const T beyond = notBelowZero(T(abs(u) - p[0]));
      u = select(u < 0.0, T(-beyond), beyond);
    }
  }
};
GROUND_REGISTER_THRUSTER_EFFECT(DeadBand)

}  // namespace ground
