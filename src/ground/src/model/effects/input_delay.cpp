#include "ground/model/effect_registry.h"

namespace ground {

/// Dead time between command and thrust: the craft acts on u(t - d).
struct InputDelay {
  static EffectInfo info() {
    return {"input_delay",
            "dead time between command and thrust",
            {{"delay", "s", "dead time", 0, 0, 1, [](const Body<double>&) { return 0.02; }}}};
  }
  template <typename T>
  static void delay(const T* p, T& seconds) {
    seconds += p[0];
  }
};
GROUND_REGISTER_EFFECT(InputDelay)

}  // namespace ground
