#include "ground/model/effect_registry.h"

namespace ground {

/// Reversible thrusters push less backward than forward, as propellers whose blades are shaped for one way
/// do.
struct ReverseLoss {
  static constexpr bool kUsesPose = false;

  static EffectInfo info() {
    return {"reverse_loss",
            "reversible thrusters push less backward than forward",
            {{"a", "-", "share of the thrust that is lost backward", 0, -1, 1,
              [](const Body<double>&) { return 0.1; }}},
            0,
            0,
            [](const ThrusterLayout& layout) { return layout.any(reverses); }};
  }
  template <typename T>
  static void thrust(const T* p, const Point<T>& point, Thrusters<T>& force) {
    for (int i = 0; i < force.size(); ++i)
      if (reverses(point.layout[i]))
        force(i) *= whereAbove(
            0.0, point.input(i), [](const T&) { return T(1.0); }, T(1.0 - p[0]));
  }

 private:
  static bool reverses(const Thruster& one) { return !one.isAngle() && one.least < 0; }
};
GROUND_REGISTER_EFFECT(ReverseLoss)

}  // namespace ground
