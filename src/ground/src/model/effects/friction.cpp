// Dry friction on the floor.
#include <cmath>

#include "ground/model/effect_registry.h"
#include "ground/model/typical.h"

namespace ground {

namespace {

// Shared by the effects of dry friction.

constexpr double kSlow = 0.01;    ///< speed below which friction is proportional to it [m/s]
constexpr double kSlowYaw = 0.1;  ///< yaw rate below which the moment is proportional to it [rad/s]

/// Sign of x, smooth at zero: x / sqrt(x^2 + slow^2).
template <typename T>
T smoothSign(const T& x, double slow) {
  using std::sqrt;
  return x / sqrt(x * x + slow * slow);
}

/// Adds a force [N] against the velocity over the floor and a moment [N m] against the yaw rate.
/// Both are constant except for a smooth transition through zero.
template <typename T>
void addDryFriction(const Point<T>& point, const T& force, const T& moment, Vector3<T>& wrench) {
  using std::sqrt;
  const T &u = point.nu.x(), &v = point.nu.y();
  const T per_speed = force / sqrt(u * u + v * v + kSlow * kSlow);
  wrench(0) -= per_speed * u;
  wrench(1) -= per_speed * v;
  wrench(2) -= moment * smoothSign(point.nu.z(), kSlowYaw);
}

}  // namespace

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

/// Yaw damping that differs by the direction of spin: N = -n_a |r|, with |r| smoothed at zero. The
/// damping is N_r + n_a for clockwise spin seen from above (r > 0) and N_r - n_a for the opposite
/// direction.
struct DirectionalYawDamping {
  static constexpr bool kUsesPose = false;

  static EffectInfo info() {
    return {"directional_yaw_damping",
            "yaw damping that differs by direction",
            {{"na", "N m s", "more damping clockwise, less the other way", 0, -kUnbounded, kUnbounded,
              typical::momentPer(0, 1)}}};
  }
  template <typename T>
  static void wrench(const T* p, const Point<T>& point, Vector3<T>& wrench) {
    const T& r = point.nu.z();
    wrench(2) -= p[0] * r * smoothSign(r, kSlowYaw);
  }
};
GROUND_REGISTER_EFFECT(DirectionalYawDamping)

}  // namespace ground
