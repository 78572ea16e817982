#include <cmath>

#include "ground/model/effect_registry.h"
#include "ground/model/typical.h"

namespace ground {

/// Drag that grows with the square of speed: -c_x V u, -c_y V v, -c_r |r| r, where V is the speed
/// through the air.
struct QuadraticDrag {
  static constexpr bool kUsesPose = false;

  static EffectInfo info() {
    return {"quadratic_drag",
            "drag that grows with speed squared",
            {{"cx", "N s^2/m^2", "surge", 0, 0, kUnbounded, typical::forcePer(2)},
             {"cy", "N s^2/m^2", "sway", 0, 0, kUnbounded, typical::forcePer(2)},
             {"cr", "N m s^2", "yaw", 0, 0, kUnbounded, typical::momentPer(0, 2)}}};
  }
  template <typename T>
  static void wrench(const T* p, const Point<T>& point, Vector3<T>& wrench) {
    using std::abs;
    using std::sqrt;
    const T &u = point.nu_air.x(), &v = point.nu_air.y(), &r = point.nu.z();
    const T square = u * u + v * v;
    const T speed = whereAbove(
        0.0, square, [](const T& x) { return T(sqrt(x)); }, T(0.0));
    wrench(0) -= p[0] * speed * u;
    wrench(1) -= p[1] * speed * v;
    wrench(2) -= p[2] * abs(r) * r;
  }
};
GROUND_REGISTER_EFFECT(QuadraticDrag)

}  // namespace ground
