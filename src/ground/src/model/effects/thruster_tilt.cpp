#include <algorithm>
#include <cmath>

#include "ground/model/effect_registry.h"

namespace ground {

/// One thruster turned about its place by an angle: F along (cos, sin) of its direction plus the
/// angle.
struct ThrusterTilt {
  static constexpr Effect::Hook kHook = Effect::kWrench;

  static EffectInfo info() {
    return {"thruster_tilt",
            "turned thruster",
            {{"angle", "rad", "angle, positive clockwise seen from above", 0, -M_PI, M_PI,
              [](const Body<double>&) { return 0.1; }}}};
  }
  /// One that turns has angle_offset.
  static bool suits(const ThrusterLayout& layout, int thruster) {
    const auto& all = layout.links();
    const auto turned = [&](const ThrusterLayout::Link& one) {
      return !one.foil && one.thruster == thruster;
    };
    return layout.pushes(thruster) && layout.size() > 1 && std::none_of(all.begin(), all.end(), turned);
  }
  template <typename T>
  static void act(const T* p, const Point<T>& point, int thruster, Vector3<T>& wrench) {
    const ThrusterLayout& layout = point.layout;
    const Rotation<T> turned = Rotation<T>(p[0]);
    const T along = point.thrust(thruster) * (turned.c - 1.0);
    const T across = point.thrust(thruster) * turned.s;
    wrench(0) += layout.forward(thruster) * along - layout.starboard(thruster) * across;
    wrench(1) += layout.starboard(thruster) * along + layout.forward(thruster) * across;
    wrench(2) += point.body.l * (layout.lever(thruster) * along + layout.along(thruster) * across);
  }
};
GROUND_REGISTER_THRUSTER_EFFECT(ThrusterTilt)

}  // namespace ground
