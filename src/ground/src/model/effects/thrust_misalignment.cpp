#include <algorithm>
#include <cmath>

#include "ground/model/effect_registry.h"

namespace ground {

/// Thrusters turned by a common angle, each about its place: X = F cos, Y = F sin, N = l (F_L - F_R) cos of a
/// left and a right one.
struct ThrustMisalignment {
  static constexpr bool kUsesPose = false;

  static EffectInfo info() {
    return {"thrust_misalignment",
            "thrust at an angle to the body axis",
            {{"angle", "rad", "angle, positive to starboard", 0, -M_PI, M_PI,
              [](const Body<double>&) { return 0.1; }}},
            0,
            0,
            [](const ThrusterLayout& layout) {  // one that turns has angle_offset
              const auto& all = layout.links();
              return std::all_of(all.begin(), all.end(), [](const auto& one) { return one.foil; });
            }};
  }
  template <typename T>
  static void wrench(const T* p, const Point<T>& point, Vector3<T>& wrench) {
    const ThrusterLayout& layout = point.layout;
    const Vector3<T> total = layout.total(point.thrust);
    const Rotation<T> turned = Rotation<T>(p[0]);
    const T lost = turned.c - 1.0;
    const T& across = turned.s;
    T along(0.0);
    for (int i = 0; i < layout.size(); ++i) along += layout.along(i) * point.thrust(i);
    wrench(0) += total(0) * lost - total(1) * across;
    wrench(1) += total(0) * across + total(1) * lost;
    wrench(2) += point.body.l * (total(2) * lost + along * across);
  }
};
GROUND_REGISTER_EFFECT(ThrustMisalignment)

}  // namespace ground
