// Where the mocap sees the craft.
#include "ground/model/effect_registry.h"
#include "ground/model/typical.h"

namespace ground {

/// The mocap's rigid body is rotated relative to the craft: measured psi = psi + psi0.
struct HeadingOffset {
  static EffectInfo info() {
    return {"heading_offset",
            "constant offset of the measured heading",
            {{"psi0", "rad", "measured minus true heading", 0, -M_PI, M_PI, typical::constant(0.1)}}};
  }
  template <typename T>
  static void measure(const T* p, const Vector3<T>&, Measurement<T>& measurement) {
    measurement.eta.z() += p[0];
    const Vector2<T> nu = measurement.nu.template head<2>();
    measurement.nu.template head<2>() = worldToBody<T>(p[0], nu);
  }
};
GROUND_REGISTER_EFFECT(HeadingOffset)

/// The mocap's rigid body has its pivot at (dx, dy) in the body frame.
struct MarkerOffset {
  static EffectInfo info() {
    const auto scale = [](const Body<double>& b) { return 0.1 * b.l; };
    return {"marker_offset",
            "tracked point away from the body origin",
            {{"dx", "m", "forward", 0, -kUnbounded, kUnbounded, scale},
             {"dy", "m", "to starboard", 0, -kUnbounded, kUnbounded, scale}}};
  }
  template <typename T>
  static void measure(const T* p, const Vector3<T>& eta, Measurement<T>& measurement) {
    measurement.eta.template head<2>() += bodyToWorld<T>(eta.z(), Vector2<T>(p[0], p[1]));
    // Velocity is measured in the frame of the measured heading.
    const T& r = measurement.nu.z();
    measurement.nu.template head<2>() +=
        worldToBody<T>(measurement.eta.z() - eta.z(), Vector2<T>(-r * p[1], r * p[0]));
  }
};
GROUND_REGISTER_EFFECT(MarkerOffset)

}  // namespace ground
