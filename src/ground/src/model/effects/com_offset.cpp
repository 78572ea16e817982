#include "ground/model/effect_registry.h"

namespace ground {

/// Centre of mass at (xg, yg) from the point half-way between the thrusters, which stays the origin
/// of the body frame (Fossen 1994, 2.4). I_z remains the inertia about the centre of mass.
struct ComOffset {
  static EffectInfo info() {
    const auto scale = [](const Body<double>& b) { return 0.1 * b.l; };
    return {"com_offset",
            "centre of mass off the thrust axis",
            {{"xg", "m", "forward", 0, -kUnbounded, kUnbounded, scale},
             {"yg", "m", "to starboard", 0, -kUnbounded, kUnbounded, scale}}};
  }
  template <typename T>
  static void inertia(const T* p, const Body<T>& body, Matrix3<T>& mass) {
    const T x = body.m * p[0], y = body.m * p[1];
    mass(0, 2) -= y;
    mass(2, 0) -= y;
    mass(1, 2) += x;
    mass(2, 1) += x;
    mass(2, 2) += x * p[0] + y * p[1];
  }
};
GROUND_REGISTER_EFFECT(ComOffset)

}  // namespace ground
