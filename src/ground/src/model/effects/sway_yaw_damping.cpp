#include "ground/model/effect_registry.h"
#include "ground/model/typical.h"

namespace ground {

/// Off-diagonal linear damping: Y = -yr r, N = -nv v.
struct SwayYawDamping {
  static constexpr bool kUsesPose = false;

  static EffectInfo info() {
    return {"sway_yaw_damping",
            "damping that couples sway and yaw",
            {{"yr", "N s", "sway force per yaw rate", 0, -kUnbounded, kUnbounded, typical::forcePer(0, 1)},
             {"nv", "N s", "yaw moment per sway", 0, -kUnbounded, kUnbounded, typical::momentPer(1)}}};
  }
  template <typename T>
  static void wrench(const T* p, const Point<T>& point, Vector3<T>& wrench) {
    wrench(1) -= p[0] * point.nu.z();
    wrench(2) -= p[1] * point.nu_air.y();
  }
};
GROUND_REGISTER_EFFECT(SwayYawDamping)

}  // namespace ground
