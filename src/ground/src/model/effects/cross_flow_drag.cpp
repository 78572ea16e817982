#include <cmath>

#include "ground/model/effect_registry.h"
#include "ground/model/typical.h"

namespace ground {

/// Drag of the flow across the hull, by strips (Faltinsen 1990; Fossen 2011, 6.4.3): each strip at x has the
/// drag -c |v + x r| (v + x r) dx. The fore and the aft half of the hull have coefficients of their own,
/// times half of its length. Without a length of the hull, it is that of a bar with the craft's radius of
/// gyration.
struct CrossFlowDrag {
  static constexpr bool kUsesPose = false;

  static EffectInfo info() {
    const auto scale = typical::forcePer(2);
    return EffectInfo{"cross_flow_drag",
                      "drag of the flow across the hull",
                      {{"fore", "N s^2/m^2", "of the fore half", 0, 0, kUnbounded, scale},
                       {"aft", "N s^2/m^2", "of the aft half", 0, 0, kUnbounded, scale}}}
        .of(Surroundings::kWater);
  }
  template <typename T>
  static void wrench(const T* p, const Point<T>& point, Vector3<T>& wrench) {
    using std::abs;
    // Gauss's points of three strips over a half, in half lengths from midship, and their weights.
    constexpr double kPlace[] = {0.1127016653792583, 0.5, 0.8872983346207417};
    constexpr double kWeight[] = {5.0 / 18, 4.0 / 9, 5.0 / 18};
    const T half = point.body.halfHull();
    const T &v = point.nu_air.y(), &r = point.nu.z();
    for (int side = 0; side < 2; ++side)
      for (int i = 0; i < 3; ++i) {
        const T x = (side == 0 ? kPlace[i] : -kPlace[i]) * half, flow = v + x * r;
        const T drag = kWeight[i] * p[side] * abs(flow) * flow;
        wrench(1) -= drag;
        wrench(2) -= x * drag;
      }
  }
};
GROUND_REGISTER_EFFECT(CrossFlowDrag)

}  // namespace ground
