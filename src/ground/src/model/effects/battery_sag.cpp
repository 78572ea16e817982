#include <cmath>

#include "ground/model/effect_registry.h"

namespace ground {

/// Thrust that fades as the battery empties: k exp(-t/tau), t since the drive began.
/// The coordinate is the rate 1/tau, which is zero for a battery that does not sag.
struct BatterySag {
  static constexpr bool kUsesPose = false;

  static EffectInfo info() {
    const double infinity = std::numeric_limits<double>::infinity();
    return {"battery_sag",
            "thrust that fades during a drive",
            {{"tau", "s", "time constant", infinity, 1, infinity,
              [](const Body<double>&) { return 1 / 100.0; }, Coordinate::kReciprocal}}};
  }
  template <typename T>
  static void thrust(const T* p, const Point<T>& point, Thrusters<T>& force) {
    using std::exp;
    force *= T(exp(-point.t * p[0]));
  }
};
GROUND_REGISTER_EFFECT(BatterySag)

}  // namespace ground
