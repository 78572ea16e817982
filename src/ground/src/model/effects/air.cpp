// Drag and damping by the air.
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

/// The lift fan takes in air at rest and gives it the craft's velocity: -lift q (u, v).
struct MomentumDrag {
  static constexpr bool kUsesPose = false;

  static EffectInfo info() {
    return EffectInfo{"momentum_drag",
                      "drag by air that the lift fan takes in",
                      {{"q", "kg/s", "mass flow at full lift", 0, 0, kUnbounded, typical::forcePer(1)}}}
        .of(Surroundings::kLift);
  }
  template <typename T>
  static void wrench(const T* p, const Point<T>& point, Vector3<T>& wrench) {
    wrench.template head<2>() -= point.lift * p[0] * point.nu_air.template head<2>();
  }
};
GROUND_REGISTER_EFFECT(MomentumDrag)

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

/// Moving air: everything aerodynamic acts on the velocity relative to it.
struct Wind {
  static EffectInfo info() {
    const auto scale = [](const Body<double>& b) { return 0.2 * typical::speed(b); };
    return EffectInfo{"wind",
                      "air that moves over the floor",
                      {{"wx", "m/s", "velocity along world x", 0, -20, 20, scale},
                       {"wy", "m/s", "velocity along world y", 0, -20, 20, scale}}}
        .of(Surroundings::kFloor);
  }
  template <typename T>
  static void air(const T* p, Vector2<T>& velocity) {
    velocity += Vector2<T>(p[0], p[1]);
  }
};
GROUND_REGISTER_EFFECT(Wind)

}  // namespace ground
