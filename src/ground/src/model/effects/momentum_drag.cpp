#include "ground/model/effect_registry.h"
#include "ground/model/typical.h"

namespace ground {

/// The lift fan takes in air at rest and gives it the craft's velocity: -lift q (u, v).
struct MomentumDrag {
  static constexpr bool kUsesPose = false;

  static EffectInfo info() {
    return EffectInfo{"momentum_drag",
                      "drag by air that the lift fan takes in",
                      {{"q", "kg/s", "mass flow at full lift", 0, 0, kUnbounded, typical::forcePer(1)}}}
        .of(Surroundings::kLift);
  }
  template <typename T>
  static void wrench(const T* p, const Point<T>& point, Vector3<T>& wrench) {
    wrench.template head<2>() -= point.lift * p[0] * point.nu_air.template head<2>();
  }
};
GROUND_REGISTER_EFFECT(MomentumDrag)

}  // namespace ground
