// The force of thrusters, and what it does to the craft.
#include <algorithm>
#include <cmath>

#include "ground/model/effect_registry.h"
#include "ground/model/typical.h"

namespace ground {

/// Thrust that fades as the battery empties: k exp(-t/tau), t since the drive began.
/// The coordinate is the rate 1/tau, which is zero for a battery that does not sag.
struct BatterySag {
  static constexpr bool kUsesPose = false;

  static EffectInfo info() {
    const double infinity = std::numeric_limits<double>::infinity();
    return {"battery_sag",
            "thrust that fades during a drive",
            {{"tau", "s", "time constant", infinity, 1, infinity, typical::constant(1 / 100.0),
              Coordinate::kReciprocal}}};
  }
  template <typename T>
  static void thrust(const T* p, const Point<T>& point, Thrusters<T>& force) {
    using std::exp;
    force *= T(exp(-point.t * p[0]));
  }
};
GROUND_REGISTER_EFFECT(BatterySag)

/// Thrust that follows the voltage of the battery: k (V/V0)^p, where k holds at V0. A motor without load
/// turns in proportion to its voltage and thrust is the square of the speed, so that p is 2; resistance
/// and a loaded propeller make it less. The flight controller ArduPilot compensates by a mixture of p = 1
/// and p = 2 (AP_MotorsMulticopter, update_lift_max_from_batt_voltage). Without a voltage nothing changes:
/// battery_sag then follows the time. A diagnosis tries it where a voltage is recorded.
struct BatteryVoltage {
  static constexpr bool kUsesPose = false;

  static EffectInfo info() {
    return {"battery_voltage",
            "thrust that follows the battery voltage",
            {{"p", "-", "power of the voltage over that at which k holds", 0, 0, 5, typical::constant(1.0)}},
            0,
            0,
            nullptr,
            true};
  }
  template <typename T>
  static void thrust(const T* p, const Point<T>& point, Thrusters<T>& force) {
    using std::exp, std::log;
    if (!point.volts || !(point.body.volts > 0)) return;
    const Given<T> logarithm = log(*point.volts / point.body.volts);
    force *= T(exp(p[0] * logarithm));
  }
};
GROUND_REGISTER_EFFECT(BatteryVoltage)

/// Thrusters that share a supply of air or current: the force of each falls with the inputs of the others,
/// F / (1 + s sum |u_j|).
struct SupplyDroop {
  static constexpr bool kUsesPose = false;

  static EffectInfo info() {
    return {"supply_droop",
            "thrust that falls as more thrusters work",
            {{"s", "-", "relative loss per other thruster at full input", 0, 0, 10, typical::constant(0.05)}},
            0,
            0,
            [](const ThrusterLayout& layout) { return layout.forces() > 2; }};
  }
  template <typename T>
  static void thrust(const T* p, const Point<T>& point, Thrusters<T>& force) {
    using std::abs;
    Thrusters<T> total = Thrusters<T>::zero(force.size());  // of each supply, at its first thruster
    for (int i = 0; i < force.size(); ++i)
      if (point.layout.pushes(i)) total(point.layout.supply(i)) += abs(point.input(i));
    for (int i = 0; i < force.size(); ++i)
      if (point.layout.pushes(i))
        force(i) = force(i) / (1.0 + p[0] * (total(point.layout.supply(i)) - abs(point.input(i))));
  }
};
GROUND_REGISTER_EFFECT(SupplyDroop)

/// Nonlinear thrust characteristic, thrust ~ |w|^p. The thrust at the end of the range of a thruster's
/// inputs is unchanged.
struct ThrustCurve {
  static constexpr bool kUsesPose = false;

  static EffectInfo info() {
    return {"thrust_curve",
            "thrust as a power of the input",
            {{"p", "-", "exponent", 1, 0.2, 5, typical::constant(0.2)}}};
  }
  template <typename T>
  static void thrust(const T* p, const Point<T>& point, Thrusters<T>& force) {
    using std::abs;
    using std::pow;
    for (int i = 0; i < force.size(); ++i) {
      const Thruster& one = point.layout[i];
      const double end = std::max(one.most, -one.least) * point.body.input_max;
      const T w = abs(point.input(i)) / end;
      force(i) *= whereAbove(
          kMinInput, w, [&](const T& x) { return T(pow(x, T(p[0] - 1.0))); }, T(1.0));
    }
  }

 private:
  /// Relative input below which the thruster is off; the power has no derivative at 0.
  static constexpr double kMinInput = 1e-9;
};
GROUND_REGISTER_EFFECT(ThrustCurve)

/// Reversible thrusters push less backward than forward, as propellers whose blades are shaped for one way
/// do.
struct ReverseLoss {
  static constexpr bool kUsesPose = false;

  static EffectInfo info() {
    return {"reverse_loss",
            "reversible thrusters push less backward than forward",
            {{"a", "-", "share of the thrust that is lost backward", 0, -1, 1, typical::constant(0.1)}},
            0,
            0,
            [](const ThrusterLayout& layout) { return layout.any(reverses); }};
  }
  template <typename T>
  static void thrust(const T* p, const Point<T>& point, Thrusters<T>& force) {
    for (int i = 0; i < force.size(); ++i)
      if (reverses(point.layout[i]))
        force(i) *= whereAbove(
            0.0, point.input(i), [](const T&) { return T(1.0); }, T(1.0 - p[0]));
  }

 private:
  static bool reverses(const Thruster& one) { return !one.isAngle() && one.least < 0; }
};
GROUND_REGISTER_EFFECT(ReverseLoss)

/// Propellers whose commands are revolutions n, thrust k n |n| at rest (curve of power 2): it falls by
/// k b |n| a at the speed a along the force, the linear part of K_T(J).
struct PropellerLoss {
  static constexpr bool kUsesPose = false;

  static EffectInfo info() {
    return {"propeller_loss",
            "thrust of propellers that falls with speed over revolutions",
            {{"b", "s/m", "loss per speed, relative at full revolutions", 0, -5, 5,
              [](const Body<double>& b) { return 0.1 / typical::speed(b); }}},
            0,
            0,
            [](const ThrusterLayout& layout) { return layout.any(isPropeller); }};
  }
  template <typename T>
  static void thrust(const T* p, const Point<T>& point, Thrusters<T>& force) {
    using std::abs;
    for (int i = 0; i < force.size(); ++i) {
      if (!isPropeller(point.layout[i])) continue;
      const T along =
          point.layout.forward(i) * point.nu_air.x() + point.layout.starboard(i) * point.nu_air.y();
      force(i) -= point.layout[i].gain * point.body.k * p[0] * abs(point.input(i)) * along;
    }
  }

 private:
  static bool isPropeller(const Thruster& one) { return !one.isAngle() && one.curve.power == 2; }
};
GROUND_REGISTER_EFFECT(PropellerLoss)

/// Propellers that lose thrust with the air speed at their inlet: k (1 - c u), never below zero. The air
/// speed is that along the force.
struct ThrustSpeedLoss {
  static constexpr bool kUsesPose = false;

  static EffectInfo info() {
    return {"thrust_speed_loss",
            "thrust that falls with surge speed",
            {{"c", "s/m", "relative loss per surge", 0, -5, 5,
              [](const Body<double>& b) { return 0.1 / typical::speed(b); }}}};
  }
  template <typename T>
  static void thrust(const T* p, const Point<T>& point, Thrusters<T>& force) {
    for (int i = 0; i < force.size(); ++i) {
      const T along =
          point.layout.forward(i) * point.nu_air.x() + point.layout.starboard(i) * point.nu_air.y();
      const T inflow = select(force(i) < 0.0, T(-along), along);
      force(i) *= notBelowZero(T(1.0 - p[0] * inflow));
    }
  }
};
GROUND_REGISTER_EFFECT(ThrustSpeedLoss)

namespace {

constexpr double kMiddle = 1e-9;  // largest y / l of a thruster on the x axis

/// The y of a thruster, over l.
double toStarboard(const ThrusterLayout& layout, int i) {
  return layout.along(i) * layout.starboard(i) - layout.lever(i) * layout.forward(i);
}

}  // namespace

/// Unequal thrusters: k_L = k (1 + a), k_R = k (1 - a). On crafts with other thrusters, those to the
/// left of the body's x axis (y < 0) have k (1 + a), those to its right k (1 - a).
struct ThrustAsymmetry {
  static constexpr bool kUsesPose = false;

  static EffectInfo info() {
    return {"thrust_asymmetry",
            "unequal left and right thrusters",
            {{"a", "-", "relative difference", 0, -1, 1, typical::constant(0.1)}}};
  }
  template <typename T>
  static void thrust(const T* p, const Point<T>& point, Thrusters<T>& force) {
    for (int i = 0; i < force.size(); ++i) {
      const double side = toStarboard(point.layout, i);
      if (side < -kMiddle) force(i) *= 1.0 + p[0];
      if (side > kMiddle) force(i) *= 1.0 - p[0];
    }
  }
};
GROUND_REGISTER_EFFECT(ThrustAsymmetry)

/// One thruster weaker or stronger than the others: F (1 + a).
struct ThrusterGain {
  static constexpr Effect::Hook kHook = Effect::kThrust;

  static EffectInfo info() {
    return {"thruster_gain",
            "weak or strong thruster",
            {{"a", "-", "relative change of its thrust", 0, -1, 1, typical::constant(0.1)}}};
  }
  template <typename T>
  static void act(const T* p, const Point<T>&, int thruster, Thrusters<T>& force) {
    force(thruster) *= 1.0 + p[0];
  }
};
GROUND_REGISTER_THRUSTER_EFFECT(ThrusterGain)

/// One thruster turned about its place by an angle: F along (cos, sin) of its direction plus the
/// angle.
struct ThrusterTilt {
  static constexpr Effect::Hook kHook = Effect::kWrench;

  static EffectInfo info() {
    return {"thruster_tilt",
            "turned thruster",
            {{"angle", "rad", "angle, positive clockwise seen from above", 0, -M_PI, M_PI,
              typical::constant(0.1)}}};
  }
  /// One that turns has angle_offset.
  static bool suits(const ThrusterLayout& layout, int thruster) {
    const auto& all = layout.links();
    const auto turned = [&](const ThrusterLayout::Link& one) {
      return !one.foil && one.thruster == thruster;
    };
    return layout.pushes(thruster) && layout.size() > 1 && std::none_of(all.begin(), all.end(), turned);
  }
  template <typename T>
  static void act(const T* p, const Point<T>& point, int thruster, Vector3<T>& wrench) {
    const ThrusterLayout& layout = point.layout;
    const Rotation<T> turned = Rotation<T>(p[0]);
    const T along = point.thrust(thruster) * (turned.c - 1.0);
    const T across = point.thrust(thruster) * turned.s;
    wrench(0) += layout.forward(thruster) * along - layout.starboard(thruster) * across;
    wrench(1) += layout.starboard(thruster) * along + layout.forward(thruster) * across;
    wrench(2) += point.body.l * (layout.lever(thruster) * along + layout.along(thruster) * across);
  }
};
GROUND_REGISTER_THRUSTER_EFFECT(ThrusterTilt)

/// Thrusters turned by a common angle, each about its place: X = F cos, Y = F sin, N = l (F_L - F_R) cos of a
/// left and a right one.
struct ThrustMisalignment {
  static constexpr bool kUsesPose = false;

  static EffectInfo info() {
    return {"thrust_misalignment",
            "thrust at an angle to the body axis",
            {{"angle", "rad", "angle, positive to starboard", 0, -M_PI, M_PI, typical::constant(0.1)}},
            0,
            0,
            [](const ThrusterLayout& layout) {  // one that turns has angle_offset
              const auto& all = layout.links();
              return std::all_of(all.begin(), all.end(), [](const auto& one) { return one.foil; });
            }};
  }
  template <typename T>
  static void wrench(const T* p, const Point<T>& point, Vector3<T>& wrench) {
    const ThrusterLayout& layout = point.layout;
    const Vector3<T> total = layout.total(point.thrust);
    const Rotation<T> turned = Rotation<T>(p[0]);
    const T lost = turned.c - 1.0;
    const T& across = turned.s;
    T along(0.0);
    for (int i = 0; i < layout.size(); ++i) along += layout.along(i) * point.thrust(i);
    wrench(0) += total(0) * lost - total(1) * across;
    wrench(1) += total(0) * across + total(1) * lost;
    wrench(2) += point.body.l * (total(2) * lost + along * across);
  }
};
GROUND_REGISTER_EFFECT(ThrustMisalignment)

/// Thrusters in cross-flow: yaw moment N = c F v that grows with thrust and sway; of thrusters that
/// point elsewhere with the speed across each.
struct ThrustSwayMoment {
  static constexpr bool kUsesPose = false;

  static EffectInfo info() {
    return {"thrust_sway_moment",
            "yaw moment of thrusters in cross-flow",
            {{"c", "s", "moment per thrust and sway", 0, -10, 10,
              [](const Body<double>& b) { return 0.1 * b.l / typical::speed(b); }}}};
  }
  template <typename T>
  static void wrench(const T* p, const Point<T>& point, Vector3<T>& wrench) {
    const Vector3<T> total = point.layout.total(point.thrust);
    wrench(2) += p[0] * (total(0) * point.nu_air.y() - total(1) * point.nu_air.x());
  }
};
GROUND_REGISTER_EFFECT(ThrustSwayMoment)

/// Side force of unequal thrusts: Y = c (F_L - F_R); of other thrusters c times their moment over l.
struct DifferentialSideForce {
  static constexpr bool kUsesPose = false;

  static EffectInfo info() {
    return {"differential_side_force",
            "side force of unequal thrusts",
            {{"c", "-", "side force per difference of thrust", 0, -10, 10, typical::constant(0.1)}}};
  }
  template <typename T>
  static void wrench(const T* p, const Point<T>& point, Vector3<T>& wrench) {
    wrench(1) += p[0] * point.layout.total(point.thrust)(2);
  }
};
GROUND_REGISTER_EFFECT(DifferentialSideForce)

}  // namespace ground
