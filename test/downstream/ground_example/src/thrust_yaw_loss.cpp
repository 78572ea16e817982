#include <cmath>

#include "ground/model/effect_registry.h"
#include "ground/model/typical.h"

namespace ground_example {

using namespace ground;

/// Thrusters that lose thrust while the craft spins: F (1 - c |r|), never below zero.
struct ThrustYawLoss {
  static constexpr bool kUsesPose = false;

  static EffectInfo info() {
    return {"thrust_yaw_loss",
            "thrust falls with the yaw rate",
            {{"c", "s/rad", "relative loss per yaw rate", 0, 0, 1,
              [](const Body<double>& b) { return 0.1 / typical::yawRate(b); }}}};
  }
  template <typename T>
  static void thrust(const T* p, const Point<T>& point, Thrusters<T>& force) {
    using std::abs;
    const T factor = 1.0 - p[0] * abs(point.nu.z());
    force *= notBelowZero(factor);
  }
};
GROUND_REGISTER_EFFECT(ThrustYawLoss)

}  // namespace ground_example
