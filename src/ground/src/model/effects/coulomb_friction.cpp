#include <cmath>

#include "ground/model/effect_registry.h"
#include "ground/model/typical.h"

namespace ground {

/// Dry friction of a skirt that touches the floor: a force against the velocity over the floor and
/// a moment against the yaw rate, constant but for the smooth passage through zero.
struct CoulombFriction {
  static constexpr bool kUsesPose = false;

  static EffectInfo info() {
    return {"coulomb_friction",
            "dry friction on the floor",
            {{"f", "N", "friction force", 0, 0, 1e3,
              [](const Body<double>& b) { return 0.1 * typical::force(b); }},
             {"n", "N m", "friction moment", 0, 0, 1e3,
              [](const Body<double>& b) { return 0.1 * typical::moment(b); }}}};
  }
  template <typename T>
  static void wrench(const T* p, const Point<T>& point, Vector3<T>& wrench) {
    using std::sqrt;
    const T &u = point.nu.x(), &v = point.nu.y(), &r = point.nu.z();
    const T force = p[0] / sqrt(u * u + v * v + kSlow * kSlow);
    wrench(0) -= force * u;
    wrench(1) -= force * v;
    wrench(2) -= p[1] * r / sqrt(r * r + kSlowYaw * kSlowYaw);
  }

 private:
  static constexpr double kSlow = 0.01;    // [m/s] below which friction is proportional to speed
  static constexpr double kSlowYaw = 0.1;  // [rad/s]
};
GROUND_REGISTER_EFFECT(CoulombFriction)

}  // namespace ground
