#include <cmath>

#include "ground/model/effect_registry.h"

namespace ground {

/// Curved thrust characteristic, thrust ~ w^p; thrust at the largest input stays as it is.
struct ThrustCurve {
  static constexpr bool kUsesPose = false;

  static EffectInfo info() {
    return {"thrust_curve",
            "thrust grows with a power of the input",
            {{"p", "-", "exponent", 1, 0.2, 5, [](const Body<double>&) { return 0.2; }}}};
  }
  template <typename T>
  static void thrust(const T* p, const Point<T>& point, Vector2<T>& force) {
    using std::pow;
    for (int side = 0; side < 2; ++side) {
      const T w = point.input(side) / point.body.input_max;
      force(side) = choose(
          valueOf(w) > kOff, [&] { return T(force(side) * pow(w, T(p[0] - 1.0))); },
          [&] { return force(side); });
    }
  }

 private:
  static constexpr double kOff =
      1e-9;  // below, the thruster is off and the power has no derivative
};
GROUND_REGISTER_EFFECT(ThrustCurve)

}  // namespace ground
