#include "ground/model/effect_registry.h"
#include "ground/model/typical.h"

namespace ground {

/// Water that moves over the ground. Damping and added mass act on the velocity relative to it; the craft's
/// own mass on that over the ground (Fossen 2011, 8.3):
/// M_RB nu' + C_RB(nu) nu + M_A nu_r' + C_A(nu_r) nu_r + D nu_r = tau, where nu_r = nu - R' w and R' w turns
/// in the body's frame. Without added mass it acts as `wind`.
struct Current {
  static EffectInfo info() {
    const auto scale = [](const Body<double>& b) { return 0.2 * typical::speed(b); };
    return EffectInfo{"current",
                      "water that moves over the ground",
                      {{"wx", "m/s", "velocity along world x", 0, -20, 20, scale},
                       {"wy", "m/s", "velocity along world y", 0, -20, 20, scale}}}
        .of(Surroundings::kWater);
  }
  template <typename T>
  static void air(const T* p, Vector2<T>& velocity) {
    velocity += Vector2<T>(p[0], p[1]);
  }
  template <typename T>
  static void wrench(const T* p, const Point<T>& point, Vector3<T>& wrench) {
    const Vector2<T> w = point.heading.toBody({p[0], p[1]});
    // The difference of the added masses in surge and sway, which alone remains of -C_A(nu_r) nu_r + C_A(nu)
    // nu + M_A (R' w)'.
    const T munk = point.mass(0, 0) - point.mass(1, 1);
    const T &u = point.nu.x(), &v = point.nu.y(), &r = point.nu.z();
    wrench(0) += munk * r * w.y();
    wrench(1) += munk * r * w.x();
    wrench(2) += munk * (w.x() * w.y() - u * w.y() - v * w.x());
  }
};
GROUND_REGISTER_EFFECT(Current)

}  // namespace ground
