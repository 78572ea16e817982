#include <algorithm>
#include <cmath>

#include "ground/model/effect_registry.h"

namespace ground {

/// Nonlinear thrust characteristic, thrust ~ |w|^p. The thrust at the end of the range of a thruster's
/// inputs is unchanged.
struct ThrustCurve {
  static constexpr bool kUsesPose = false;

  static EffectInfo info() {
    return {"thrust_curve",
            "thrust as a power of the input",
            {{"p", "-", "exponent", 1, 0.2, 5, [](const Body<double>&) { return 0.2; }}}};
  }
  template <typename T>
  static void thrust(const T* p, const Point<T>& point, Thrusters<T>& force) {
    using std::abs;
    using std::pow;
    for (int i = 0; i < force.size(); ++i) {
      const Thruster& one = point.layout[i];
      const double end = std::max(one.most, -one.least) * point.body.input_max;
      const T w = abs(point.input(i)) / end;
      force(i) *= whereAbove(
          kMinInput, w, [&](const T& x) { return T(pow(x, T(p[0] - 1.0))); }, T(1.0));
    }
  }

 private:
  /// Relative input below which the thruster is off; the power has no derivative at 0.
  static constexpr double kMinInput = 1e-9;
};
GROUND_REGISTER_EFFECT(ThrustCurve)

}  // namespace ground
