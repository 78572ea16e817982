#include "ground/model/effect_registry.h"

namespace ground {

/// A floor that is not level: gravity acts on the centre of mass with the force m g (sx, sy) in
/// world_ned. A floor with positive slope descends along the positive axis.
struct FloorTilt {
  static EffectInfo info() {
    const auto scale = [](const Body<double>&) { return 0.005; };
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
