#include <cmath>

#include "ground/model/effect_registry.h"
#include "ground/model/typical.h"

namespace ground {

/// Nonlinear manoeuvring derivatives of a hull, which decide how tight it turns at large angles of drift:
/// X = x_vvvv v^4 / V^2, Y = -(y_vvv v^3 + y_vvr v^2 r + y_vrr v r^2 + y_rrr r^3) / V, N likewise
/// (Yasukawa and Yoshimura 2015, (17) to (19)), with V^2 = u^2 + v^2 + (L r / 4)^2. The last part, small in a
/// turning circle, keeps them finite where the craft turns on the spot; L / 4 is a hull's radius of gyration.
struct HullNonlinear {
  static constexpr bool kUsesPose = false;

  static EffectInfo info() {
    using typical::forcePer, typical::momentPer;
    return EffectInfo{
        "hull_nonlinear",
        "nonlinear manoeuvring derivatives",
        {{"xvvvv", "N s^2/m^2", "surge force by drift", 0, -kUnbounded, kUnbounded, forcePer(2, 0)},
         {"yvvv", "N s^2/m^2", "side force by drift", 0, -kUnbounded, kUnbounded, forcePer(2, 0)},
         {"yvvr", "N s^2/m", "by drift, turning", 0, -kUnbounded, kUnbounded, forcePer(1, 1)},
         {"yvrr", "N s^2", "by turning, drift", 0, -kUnbounded, kUnbounded, forcePer(0, 2)},
         {"yrrr", "N m s^2", "by turning", 0, -kUnbounded, kUnbounded, forcePer(-1, 3)},
         {"nvvv", "N s^2/m", "yaw moment by drift", 0, -kUnbounded, kUnbounded, momentPer(2, 0)},
         {"nvvr", "N s^2", "by drift, turning", 0, -kUnbounded, kUnbounded, momentPer(1, 1)},
         {"nvrr", "N m s^2", "by turning, drift", 0, -kUnbounded, kUnbounded, momentPer(0, 2)},
         {"nrrr", "N m^2 s^2", "by turning", 0, -kUnbounded, kUnbounded, momentPer(-1, 3)}}}
        .of(Surroundings::kWater);
  }
  template <typename T>
  static void wrench(const T* p, const Point<T>& point, Vector3<T>& wrench) {
    using std::sqrt;
    constexpr double kTiny = 1e-12;  // a craft at rest has neither a force nor its derivative
    const T &u = point.nu_air.x(), &v = point.nu_air.y(), &r = point.nu.z();
    const T arm = 0.5 * point.body.halfHull();
    const T square = u * u + v * v + arm * arm * r * r;
    const T inverse = whereAbove(
        kTiny, square, [](const T& y) { return T(1.0 / sqrt(y)); }, T(0.0));
    const auto cubic = [&](const T* c) {
      return T(((c[0] * v + c[1] * r) * v * v + (c[2] * v + c[3] * r) * r * r) * inverse);
    };
    wrench(0) += p[0] * v * v * v * v * inverse * inverse;
    wrench(1) -= cubic(p + 1);
    wrench(2) -= cubic(p + 5);
  }
};
GROUND_REGISTER_EFFECT(HullNonlinear)

}  // namespace ground
