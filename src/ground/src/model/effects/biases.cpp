// Forces and moments that are always there.
#include "ground/model/effect_registry.h"
#include "ground/model/typical.h"

namespace ground {

/// Constant force in the body frame, such as a leak in the skirt.
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

/// A floor that is not level: gravity acts on the centre of mass with the force m g (sx, sy) in
/// world_ned. A floor with positive slope descends along the positive axis.
struct FloorTilt {
  static EffectInfo info() {
    const auto scale = typical::constant(0.005);
    return EffectInfo{"floor_tilt",
                      "floor that is not level",
                      {{"sx", "-", "slope along world x", 0, -0.5, 0.5, scale},
                       {"sy", "-", "slope along world y", 0, -0.5, 0.5, scale}}}
        .of(Surroundings::kFloor);
  }
  template <typename T>
  static void wrench(const T* p, const Point<T>& point, Vector3<T>& wrench) {
    constexpr double kGravity = 9.81;
    const T &m = point.body.m, weight = m * kGravity;
    const Vector2<T> force = point.heading.toBody({weight * p[0], weight * p[1]});
    wrench.template head<2>() += force;
    // The centre of mass (x_g, y_g) follows from the mass matrix: M_13 = -m y_g, M_23 = m x_g.
    const Matrix3<T>& mass = point.mass;
    wrench(2) += (mass(1, 2) * force.y() + mass(0, 2) * force.x()) / m;
  }
};
GROUND_REGISTER_EFFECT(FloorTilt)

}  // namespace ground
