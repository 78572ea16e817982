#include <cmath>

#include "ground/model/effect_registry.h"
#include "ground/model/typical.h"

namespace ground {

/// Propellers whose commands are revolutions n, thrust k n |n| at rest (curve of power 2): it falls by
/// k b |n| a at the speed a along the force, the linear part of K_T(J).
struct PropellerLoss {
  static constexpr bool kUsesPose = false;

  static EffectInfo info() {
    return {"propeller_loss",
            "thrust of propellers that falls with speed over revolutions",
            {{"b", "s/m", "loss per speed, relative at full revolutions", 0, -5, 5,
              [](const Body<double>& b) { return 0.1 / typical::speed(b); }}},
            0,
            0,
            [](const ThrusterLayout& layout) { return layout.any(isPropeller); }};
  }
  template <typename T>
  static void thrust(const T* p, const Point<T>& point, Thrusters<T>& force) {
    using std::abs;
    for (int i = 0; i < force.size(); ++i) {
      if (!isPropeller(point.layout[i])) continue;
      const T along =
          point.layout.forward(i) * point.nu_air.x() + point.layout.starboard(i) * point.nu_air.y();
      force(i) -= point.layout[i].gain * point.body.k * p[0] * abs(point.input(i)) * along;
    }
  }

 private:
  static bool isPropeller(const Thruster& one) { return !one.isAngle() && one.curve.power == 2; }
};
GROUND_REGISTER_EFFECT(PropellerLoss)

}  // namespace ground
