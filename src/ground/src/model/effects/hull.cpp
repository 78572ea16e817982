// A hull in water.
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

/// Resistance of a hull that drifts and turns: X = -(x_vv v^2 + x_vr v r + x_rr r^2) (Yasukawa and Yoshimura
/// 2015, (17)).
struct DriftResistance {
  static constexpr bool kUsesPose = false;

  static EffectInfo info() {
    return EffectInfo{
        "drift_resistance",
        "resistance of a hull that drifts, turns",
        {{"xvv", "N s^2/m^2", "by sway", 0, -kUnbounded, kUnbounded, typical::forcePer(2, 0)},
         {"xvr", "N s^2/m", "by sway and yaw", 0, -kUnbounded, kUnbounded, typical::forcePer(1, 1)},
         {"xrr", "N s^2", "by yaw", 0, -kUnbounded, kUnbounded, typical::forcePer(0, 2)}}}
        .of(Surroundings::kWater);
  }
  template <typename T>
  static void wrench(const T* p, const Point<T>& point, Vector3<T>& wrench) {
    const T &v = point.nu_air.y(), &r = point.nu.z();
    wrench(0) -= (p[0] * v + p[1] * r) * v + p[2] * r * r;
  }
};
GROUND_REGISTER_EFFECT(DriftResistance)

/// Lift of a hull that moves ahead at an angle or in a turn: the linear manoeuvring derivatives, which grow
/// with speed. Y = -|u| (y_v v + y_r r), N = -|u| (n_v v + n_r r) (Blanke 1981; Fossen 2011, 6.4).
struct HullLift {
  static constexpr bool kUsesPose = false;

  static EffectInfo info() {
    return EffectInfo{
        "hull_lift",
        "linear manoeuvring derivatives of a hull",
        {{"yv", "N s^2/m^2", "side force by drift", 0, -kUnbounded, kUnbounded, typical::forcePer(2)},
         {"yr", "N s^2/m", "side force by turning", 0, -kUnbounded, kUnbounded, typical::forcePer(1, 1)},
         {"nv", "N s^2/m", "yaw moment by drift", 0, -kUnbounded, kUnbounded, typical::momentPer(2)},
         {"nr", "N s^2", "yaw moment by turning", 0, -kUnbounded, kUnbounded, typical::momentPer(1, 1)}}}
        .of(Surroundings::kWater);
  }
  template <typename T>
  static void wrench(const T* p, const Point<T>& point, Vector3<T>& wrench) {
    using std::abs;
    const T speed = abs(point.nu_air.x());
    const T &v = point.nu_air.y(), &r = point.nu.z();
    wrench(1) -= speed * (p[0] * v + p[1] * r);
    wrench(2) -= speed * (p[2] * v + p[3] * r);
  }
};
GROUND_REGISTER_EFFECT(HullLift)

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

/// Drag of the flow across the hull, by strips (Faltinsen 1990; Fossen 2011, 6.4.3): each strip at x has the
/// drag -c |v + x r| (v + x r) dx. The fore and the aft half of the hull have coefficients of their own,
/// times half of its length. Without a length of the hull, it is that of a bar with the craft's radius of
/// gyration.
struct CrossFlowDrag {
  static constexpr bool kUsesPose = false;

  static EffectInfo info() {
    const auto scale = typical::forcePer(2);
    return EffectInfo{"cross_flow_drag",
                      "drag of the flow across the hull",
                      {{"fore", "N s^2/m^2", "of the fore half", 0, 0, kUnbounded, scale},
                       {"aft", "N s^2/m^2", "of the aft half", 0, 0, kUnbounded, scale}}}
        .of(Surroundings::kWater);
  }
  template <typename T>
  static void wrench(const T* p, const Point<T>& point, Vector3<T>& wrench) {
    using std::abs;
    // Gauss's points of three strips over a half, in half lengths from midship, and their weights.
    constexpr double kPlace[] = {0.1127016653792583, 0.5, 0.8872983346207417};
    constexpr double kWeight[] = {5.0 / 18, 4.0 / 9, 5.0 / 18};
    const T half = point.body.halfHull();
    const T &v = point.nu_air.y(), &r = point.nu.z();
    for (int side = 0; side < 2; ++side)
      for (int i = 0; i < 3; ++i) {
        const T x = (side == 0 ? kPlace[i] : -kPlace[i]) * half, flow = v + x * r;
        const T drag = kWeight[i] * p[side] * abs(flow) * flow;
        wrench(1) -= drag;
        wrench(2) -= x * drag;
      }
  }
};
GROUND_REGISTER_EFFECT(CrossFlowDrag)

/// Water that moves over the ground. Damping and added mass act on the velocity relative to it; the craft's
/// own mass on that over the ground (Fossen 2011, 8.3):
/// M_RB nu' + C_RB(nu) nu + M_A nu_r' + C_A(nu_r) nu_r + D nu_r = tau, where nu_r = nu - R' w and R' w turns
/// in the body frame. Without added mass it acts as `wind`.
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
