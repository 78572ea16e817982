#include "ground/model/effect_registry.h"
#include "ground/model/typical.h"

namespace ground {

/// Constant force in the body's frame, such as a leak in the skirt.
struct BodyForceBias {
  static constexpr bool kUsesPose = false;

  static EffectInfo info() {
    const auto scale = [](const Body<double>& b) { return 0.1 * typical::force(b); };
    return {"body_force_bias",
            "constant force in the body frame",
            {{"x0", "N", "along surge", 0, -kUnbounded, kUnbounded, scale},
             {"y0", "N", "along sway", 0, -kUnbounded, kUnbounded, scale}}};
  }
  template <typename T>
  static void wrench(const T* p, const Point<T>&, Vector3<T>& wrench) {
    wrench(0) += p[0];
    wrench(1) += p[1];
  }
};
GROUND_REGISTER_EFFECT(BodyForceBias)

}  // namespace ground
