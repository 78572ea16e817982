#include <cmath>

#include "ground/model/effect_registry.h"
#include "ground/model/typical.h"

namespace ground {

/// Resistance of a hull that drifts and turns: X = -(x_vv v^2 + x_vr v r + x_rr r^2) (Yasukawa and Yoshimura
/// 2015, (17)).
struct DriftResistance {
  static constexpr bool kUsesPose = false;

  static EffectInfo info() {
    return EffectInfo{
        "drift_resistance",
        "resistance of a hull that drifts, turns",
        {{"xvv", "N s^2/m^2", "by sway", 0, -kUnbounded, kUnbounded, typical::forcePer(2, 0)},
         {"xvr", "N s^2/m", "by sway and yaw", 0, -kUnbounded, kUnbounded, typical::forcePer(1, 1)},
         {"xrr", "N s^2", "by yaw", 0, -kUnbounded, kUnbounded, typical::forcePer(0, 2)}}}
        .of(Surroundings::kWater);
  }
  template <typename T>
  static void wrench(const T* p, const Point<T>& point, Vector3<T>& wrench) {
    const T &v = point.nu_air.y(), &r = point.nu.z();
    wrench(0) -= (p[0] * v + p[1] * r) * v + p[2] * r * r;
  }
};
GROUND_REGISTER_EFFECT(DriftResistance)

}  // namespace ground
