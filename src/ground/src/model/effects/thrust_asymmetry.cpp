#include "ground/model/effect_registry.h"

namespace ground {
namespace {

constexpr double kMiddle = 1e-9;  // largest y / l of a thruster on the x axis

/// The y of a thruster, over l.
double toStarboard(const ThrusterLayout& layout, int i) {
  return layout.along(i) * layout.starboard(i) - layout.lever(i) * layout.forward(i);
}

}  // namespace

/// Unequal thrusters: k_L = k (1 + a), k_R = k (1 - a). On crafts with other thrusters, those to the
/// left of the body's x axis (y < 0) have k (1 + a), those to its right k (1 - a).
struct ThrustAsymmetry {
  static constexpr bool kUsesPose = false;

  static EffectInfo info() {
    return {"thrust_asymmetry",
            "unequal left and right thrusters",
            {{"a", "-", "relative difference", 0, -1, 1, [](const Body<double>&) { return 0.1; }}}};
  }
  template <typename T>
  static void thrust(const T* p, const Point<T>& point, Thrusters<T>& force) {
    for (int i = 0; i < force.size(); ++i) {
      const double side = toStarboard(point.layout, i);
      if (side < -kMiddle) force(i) *= 1.0 + p[0];
      if (side > kMiddle) force(i) *= 1.0 - p[0];
    }
  }
};
GROUND_REGISTER_EFFECT(ThrustAsymmetry)

}  // namespace ground
