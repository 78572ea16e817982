#include "ground/model/effect_registry.h"

namespace ground {

/// The mocap's rigid body is rotated relative to the craft: measured psi = psi + psi0.
struct HeadingOffset {
  static EffectInfo info() {
    return {"heading_offset",
            "constant offset of the measured heading",
            {{"psi0", "rad", "measured minus true heading", 0, -M_PI, M_PI,
              [](const Body<double>&) { return 0.1; }}}};
  }
  template <typename T>
  static void measure(const T* p, const Vector3<T>&, Measurement<T>& measurement) {
    measurement.eta.z() += p[0];
    const Vector2<T> nu = measurement.nu.template head<2>();
    measurement.nu.template head<2>() = worldToBody<T>(p[0], nu);
  }
};
GROUND_REGISTER_EFFECT(HeadingOffset)

}  // namespace ground
