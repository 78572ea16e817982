#include "ground/model/effect_registry.h"
#include "ground/model/typical.h"

namespace ground {

/// Propellers that lose thrust with the air speed at their inlet: k (1 - c u), never below zero. The air
/// speed is that along the force.
struct ThrustSpeedLoss {
  static constexpr bool kUsesPose = false;

  static EffectInfo info() {
    return {"thrust_speed_loss",
            "thrust that falls with surge speed",
            {{"c", "s/m", "relative loss per surge", 0, -5, 5,
              [](const Body<double>& b) { return 0.1 / typical::speed(b); }}}};
  }
  template <typename T>
  static void thrust(const T* p, const Point<T>& point, Thrusters<T>& force) {
    for (int i = 0; i < force.size(); ++i) {
      const T along =
          point.layout.forward(i) * point.nu_air.x() + point.layout.starboard(i) * point.nu_air.y();
      const T inflow = select(force(i) < 0.0, T(-along), along);
      force(i) *= notBelowZero(T(1.0 - p[0] * inflow));
    }
  }
};
GROUND_REGISTER_EFFECT(ThrustSpeedLoss)

}  // namespace ground
