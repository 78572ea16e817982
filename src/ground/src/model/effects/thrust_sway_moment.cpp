#include "ground/model/effect_registry.h"
#include "ground/model/typical.h"

namespace ground {

/// Thrusters in cross-flow: yaw moment N = c F v that grows with thrust and sway; of thrusters that
/// point elsewhere with the speed across each.
struct ThrustSwayMoment {
  static constexpr bool kUsesPose = false;

  static EffectInfo info() {
    return {"thrust_sway_moment",
            "yaw moment of thrusters in cross-flow",
            {{"c", "s", "moment per thrust and sway", 0, -10, 10,
              [](const Body<double>& b) { return 0.1 * b.l / typical::speed(b); }}}};
  }
  template <typename T>
  static void wrench(const T* p, const Point<T>& point, Vector3<T>& wrench) {
    const Vector3<T> total = point.layout.total(point.thrust);
    wrench(2) += p[0] * (total(0) * point.nu_air.y() - total(1) * point.nu_air.x());
  }
};
GROUND_REGISTER_EFFECT(ThrustSwayMoment)

}  // namespace ground
