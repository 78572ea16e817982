#include "ground/model/effect_registry.h"

namespace ground {

/// A floor that is not level: gravity pulls the centre of mass down the slope, m g (sx, sy) in
/// world_ned; a positive slope falls along the positive axis.
struct FloorTilt {
  static EffectInfo info() {
    const auto scale = [](const Body<double>&) { return 0.005; };
    return {"floor_tilt",
            "gravity along a floor that is not level",
            {{"sx", "-", "slope along world x", 0, -0.5, 0.5, scale},
             {"sy", "-", "slope along world y", 0, -0.5, 0.5, scale}}};
  }
  template <typename T>
  static void wrench(const T* p, const Point<T>& point, Vector3<T>& wrench) {
    constexpr double kGravity = 9.81;
    const T &m = point.body.m, weight = m * kGravity;
    const Vector2<T> force = point.heading.toBody({weight * p[0], weight * p[1]});
    wrench.template head<2>() += force;
    // The mass matrix knows where the centre of mass is: M_13 = -m y_g, M_23 = m x_g.
    const Matrix3<T>& mass = point.mass;
    wrench(2) += (mass(1, 2) * force.y() + mass(0, 2) * force.x()) / m;
  }
};
GROUND_REGISTER_EFFECT(FloorTilt)

}  // namespace ground
