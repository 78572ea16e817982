#include "dry_friction.h"
#include "ground/model/effect_registry.h"
#include "ground/model/typical.h"

namespace ground {

/// Dry friction of a skirt that touches the floor: a force against the velocity over the floor and
/// a moment against the yaw rate. Both are constant except for a smooth transition through zero.
struct CoulombFriction {
  static constexpr bool kUsesPose = false;

  static EffectInfo info() {
    return EffectInfo{"coulomb_friction",
                      "dry friction on the floor",
                      {{"f", "N", "friction force", 0, 0, kUnbounded,
                        [](const Body<double>& b) { return 0.1 * typical::force(b); }},
                       {"n", "N m", "friction moment", 0, 0, kUnbounded,
                        [](const Body<double>& b) { return 0.1 * typical::moment(b); }}}}
        .of(Surroundings::kFloor);
  }
  template <typename T>
  static void wrench(const T* p, const Point<T>& point, Vector3<T>& wrench) {
    addDryFriction(point, p[0], p[1], wrench);
  }
};
GROUND_REGISTER_EFFECT(CoulombFriction)

}  // namespace ground
