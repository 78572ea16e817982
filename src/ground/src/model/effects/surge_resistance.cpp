#include <cmath>

#include "ground/model/effect_registry.h"
#include "ground/model/typical.h"

namespace ground {

/// Resistance of a hull that moves ahead or astern: X = -x_uu |u| u (Fossen 2011, 6.4).
struct SurgeResistance {
  static constexpr bool kUsesPose = false;

  static EffectInfo info() {
    return EffectInfo{"surge_resistance",
                      "resistance of the hull, X_|u|u",
                      {{"xuu", "N s^2/m^2", "at 1 m/s", 0, 0, kUnbounded, typical::forcePer(2)}}}
        .of(Surroundings::kWater);
  }
  template <typename T>
  static void wrench(const T* p, const Point<T>& point, Vector3<T>& wrench) {
    using std::abs;
    const T& u = point.nu_air.x();
    wrench(0) -= p[0] * abs(u) * u;
  }
};
GROUND_REGISTER_EFFECT(SurgeResistance)

}  // namespace ground
