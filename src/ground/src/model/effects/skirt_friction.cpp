#include "dry_friction.h"
#include "ground/model/effect_registry.h"
#include "ground/model/typical.h"

namespace ground {

/// Dry friction of the skirt on the floor that vanishes as the lift rises: (1 - lift) times a force
/// against the velocity over the floor and a moment against the yaw rate. Runs at full lift do not
/// identify it; runs at two lifts distinguish it from coulomb_friction.
struct SkirtFriction {
  static constexpr bool kUsesPose = false;

  static EffectInfo info() {
    return EffectInfo{"skirt_friction",
                      "dry friction of the skirt",
                      {{"f0", "N", "friction force without lift", 0, 0, kUnbounded,
                        [](const Body<double>& b) { return 0.5 * typical::force(b); }},
                       {"n0", "N m", "friction moment without lift", 0, 0, kUnbounded,
                        [](const Body<double>& b) { return 0.5 * typical::moment(b); }}}}
        .of(Surroundings::kLift);
  }
  template <typename T>
  static void wrench(const T* p, const Point<T>& point, Vector3<T>& wrench) {
    const Given<T> share = 1.0 - point.lift;
    addDryFriction(point, T(p[0] * share), T(p[1] * share), wrench);
  }
};
GROUND_REGISTER_EFFECT(SkirtFriction)

}  // namespace ground
