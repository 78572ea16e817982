#include <cmath>

#include "ground/model/effect_registry.h"
#include "ground/model/typical.h"

namespace ground {

/// Lift of a hull that moves ahead at an angle or in a turn: the linear manoeuvring derivatives, which grow
/// with speed. Y = -|u| (y_v v + y_r r), N = -|u| (n_v v + n_r r) (Blanke 1981; Fossen 2011, 6.4).
struct HullLift {
  static constexpr bool kUsesPose = false;

  static EffectInfo info() {
    return EffectInfo{
        "hull_lift",
        "linear manoeuvring derivatives of a hull",
        {{"yv", "N s^2/m^2", "side force by drift", 0, -kUnbounded, kUnbounded, typical::forcePer(2)},
         {"yr", "N s^2/m", "side force by turning", 0, -kUnbounded, kUnbounded, typical::forcePer(1, 1)},
         {"nv", "N s^2/m", "yaw moment by drift", 0, -kUnbounded, kUnbounded, typical::momentPer(2)},
         {"nr", "N s^2", "yaw moment by turning", 0, -kUnbounded, kUnbounded, typical::momentPer(1, 1)}}}
        .of(Surroundings::kWater);
  }
  template <typename T>
  static void wrench(const T* p, const Point<T>& point, Vector3<T>& wrench) {
    using std::abs;
    const T speed = abs(point.nu_air.x());
    const T &v = point.nu_air.y(), &r = point.nu.z();
    wrench(1) -= speed * (p[0] * v + p[1] * r);
    wrench(2) -= speed * (p[2] * v + p[3] * r);
  }
};
GROUND_REGISTER_EFFECT(HullLift)

}  // namespace ground
