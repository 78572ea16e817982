#include "ground/model/effect_registry.h"

namespace ground {

/// Side force of unequal thrusts: Y = c (F_L - F_R); of other thrusters c times their moment over l.
struct DifferentialSideForce {
  static constexpr bool kUsesPose = false;

  static EffectInfo info() {
    return {"differential_side_force",
            "side force of unequal thrusts",
            {{"c", "-", "side force per difference of thrust", 0, -10, 10,
              [](const Body<double>&) { return 0.1; }}}};
  }
  template <typename T>
  static void wrench(const T* p, const Point<T>& point, Vector3<T>& wrench) {
    wrench(1) += p[0] * point.layout.total(point.thrust)(2);
  }
};
GROUND_REGISTER_EFFECT(DifferentialSideForce)

}  // namespace ground
