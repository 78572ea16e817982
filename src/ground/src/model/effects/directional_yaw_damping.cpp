#include "dry_friction.h"
#include "ground/model/effect_registry.h"
#include "ground/model/typical.h"

namespace ground {

/// Yaw damping that differs by the direction of spin: N = -n_a |r|, with |r| smoothed at zero. The
/// damping is N_r + n_a for clockwise spin seen from above (r > 0) and N_r - n_a for the opposite
/// direction.
struct DirectionalYawDamping {
  static constexpr bool kUsesPose = false;

  static EffectInfo info() {
    return {"directional_yaw_damping",
            "yaw damping that differs by direction",
            {{"na", "N m s", "more damping clockwise, less the other way", 0, -kUnbounded, kUnbounded,
              typical::momentPer(0, 1)}}};
  }
  template <typename T>
  static void wrench(const T* p, const Point<T>& point, Vector3<T>& wrench) {
    const T& r = point.nu.z();
    wrench(2) -= p[0] * r * smoothSign(r, kSlowYaw);
  }
};
GROUND_REGISTER_EFFECT(DirectionalYawDamping)

}  // namespace ground
