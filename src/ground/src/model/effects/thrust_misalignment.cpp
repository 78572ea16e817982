#include <cmath>

#include "ground/model/effect_registry.h"

namespace ground {

/// Thrusters turned by a common angle: X = F cos, Y = F sin, N = l (F_L - F_R) cos.
struct ThrustMisalignment {
  static constexpr bool kUsesPose = false;

  static EffectInfo info() {
    return {"thrust_misalignment",
            "thrust at an angle to the body's x axis",
            {{"angle", "rad", "angle, positive to starboard", 0, -M_PI, M_PI,
              [](const Body<double>&) { return 0.1; }}}};
  }
  template <typename T>
  static void wrench(const T* p, const Point<T>& point, Vector3<T>& wrench) {
    using std::cos;
    using std::sin;
    const T total = point.thrust(0) + point.thrust(1);
    const T lost = cos(p[0]) - 1.0;
    wrench(0) += total * lost;
    wrench(1) += total * sin(p[0]);
    wrench(2) += point.body.l * (point.thrust(0) - point.thrust(1)) * lost;
  }
};
GROUND_REGISTER_EFFECT(ThrustMisalignment)

}  // namespace ground
