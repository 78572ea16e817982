#include "ground/model/effect_registry.h"
#include "ground/model/typical.h"

namespace ground {

/// Propellers that lose thrust with the air speed at their inlet: k (1 - c u), never below zero.
struct ThrustSpeedLoss {
  static constexpr bool kUsesPose = false;

  static EffectInfo info() {
    return {"thrust_speed_loss",
            "thrust falls with surge through the air",
            {{"c", "s/m", "relative loss per surge", 0, -5, 5,
              [](const Body<double>& b) { return 0.1 / typical::speed(b); }}}};
  }
  template <typename T>
  static void thrust(const T* p, const Point<T>& point, Vector2<T>& force) {
    const T factor = 1.0 - p[0] * point.nu_air.x();
    force *= blend(valueOf(factor) > 0.0, factor, T(0.0));
  }
};
GROUND_REGISTER_EFFECT(ThrustSpeedLoss)

}  // namespace ground
