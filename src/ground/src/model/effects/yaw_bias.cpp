#include "ground/model/effect_registry.h"
#include "ground/model/typical.h"

namespace ground {

/// Constant yaw moment, such as the torque of the lift fan.
struct YawBias {
  static constexpr bool kUsesPose = false;

  static EffectInfo info() {
    return {"yaw_bias",
            "constant yaw moment",
            {{"n0", "N m", "moment", 0, -kUnbounded, kUnbounded,
              [](const Body<double>& b) { return 0.1 * typical::moment(b); }}}};
  }
  template <typename T>
  static void wrench(const T* p, const Point<T>&, Vector3<T>& wrench) {
    wrench(2) += p[0];
  }
};
GROUND_REGISTER_EFFECT(YawBias)

}  // namespace ground
