#include "ground/model/effect_registry.h"
#include "ground/model/typical.h"

namespace ground {

/// Moving air: everything aerodynamic acts on the velocity relative to it.
struct Wind {
  static EffectInfo info() {
    const auto scale = [](const Body<double>& b) { return 0.2 * typical::speed(b); };
    return EffectInfo{"wind",
                      "air that moves over the floor",
                      {{"wx", "m/s", "velocity along world x", 0, -20, 20, scale},
                       {"wy", "m/s", "velocity along world y", 0, -20, 20, scale}}}
        .of(Surroundings::kFloor);
  }
  template <typename T>
  static void air(const T* p, Vector2<T>& velocity) {
    velocity += Vector2<T>(p[0], p[1]);
  }
};
GROUND_REGISTER_EFFECT(Wind)

}  // namespace ground
