// How actuators follow their commands: lags, rates, delays, supplies that sag under load.
#include <array>
#include <cmath>
#include <limits>

#include "ground/model/effect_registry.h"
#include "ground/model/typical.h"

namespace ground {

namespace {

// How an actuator approaches its command during a step, while the command is held.

/// Fraction of the initial difference from the command that remains: at the three nodes of the parabola with
/// the same mean, first and second moment, and after the step. RK4 integrates such a parabola exactly.
template <typename T>
using Remains = std::array<T, 4>;

/// The parabola of the moments, integrals of t^i times the fraction over t = 0..1.
template <typename T>
Remains<T> remainsOf(const T& m0, const T& m1, const T& m2, const T& after) {
  const T c0 = m0, c1 = 3.0 * (2.0 * m1 - m0), c2 = 5.0 * (6.0 * m2 - 6.0 * m1 + m0);
  return {T(c0 - c1 + c2), T(c0 - 0.5 * c2), T(c0 + c1 + c2), after};
}

/// Of a first-order lag with the time constant tau over a step of length h [s]. The limit tau -> 0 is smooth.
template <typename T>
Remains<T> decay(const T& tau, const T& h) {
  // Range of tau/h in which the general case is accurate.
  constexpr double kMaxRatio = 50, kMinRatio = 0.02;
  using std::exp;
  const auto none = [] { return Remains<T>{T(0.0), T(0.0), T(0.0), T(0.0)}; };
  const auto slow = [&] {
    const T end = exp(-h / tau);
    return Remains<T>{T(1.0), T(exp(-h / (2.0 * tau))), end, end};
  };
  const auto any = [&] {
    const T e = tau / h;
    const T end = choose(
        e < kMinRatio, [] { return T(0.0); }, [&] { return T(exp(-1.0 / e)); });
    const T m0 = e * (1.0 - end), m1 = e * (m0 - end), m2 = e * (2.0 * m1 - end);
    return remainsOf(m0, m1, m2, end);
  };
  return choose(tau == 0.0 && h == 0.0, none, [&] { return choose(tau > kMaxRatio * h, slow, any); });
}

/// Of a motion at a constant rate that needs `time` [s] for the whole way.
template <typename T>
Remains<T> ramp(const T& time, const T& h) {
  const auto whole = [&] {
    const T left = 1.0 - h / time;
    return Remains<T>{T(1.0), T(1.0 - 0.5 * h / time), left, left};
  };
  const auto part = [&] {
    const T x = choose(
        h == 0.0, [] { return T(0.0); }, [&] { return T(time / h); });
    return remainsOf(T(0.5 * x), T(x * x / 6.0), T(x * x * x / 12.0), T(0.0));
  };
  return choose(time > h, whole, part);
}

/// A state that moves to a target, at the three nodes of a step. Moves it to the end.
template <typename T>
std::array<T, 3> moving(const T& target, const Remains<T>& left, T& state) {
  const T difference = state - target;
  state = target + difference * left[3];
  return {T(target + difference * left[0]), T(target + difference * left[1]),
          T(target + difference * left[2])};
}

/// Moves channel i, which is at `state`, over a step.
template <typename T>
void approach(const T& command, const Remains<T>& left, int i, T& state, StepInputs<T>& inputs) {
  const std::array<T, 3> at = moving(command, left, state);
  for (std::size_t node = 0; node < 3; ++node) inputs.thrusters[node](i) = at[node];
}

/// Takes a part of a load that channel i follows from its input.
template <typename T>
void weaken(const T& part, const std::array<T, 3>& load, int i, StepInputs<T>& inputs) {
  for (std::size_t node = 0; node < 3; ++node) inputs.thrusters[node](i) *= T(1.0 - part * load[node]);
}

/// What is commanded to channel i over a step, which an earlier actuator may have changed: its mean.
template <typename T>
T commanded(const StepInputs<T>& inputs, int i) {
  const auto& at = inputs.thrusters;
  return at[0](i) + (4.0 * (at[1](i) - at[0](i)) + (at[2](i) - at[0](i))) * (1.0 / 6);
}

/// Moves channel i over a step with one lag where its input rises, away from 0, and another where it falls. A
/// step in which the input changes its sign keeps the lag with which it began.
template <typename T>
void riseOrFall(const Remains<T>& rising, const Remains<T>& falling, int i, T& state, StepInputs<T>& inputs) {
  const T command = commanded(inputs, i);
  approach(command, select(state * (command - state) < 0.0, falling, rising), i, state, inputs);
}

}  // namespace

/// First-order lag of each thruster, dw/dt = (u - w)/tau, thrust from w. Angles are not thrusters (AngleLag).
///
/// The command is held over a step, so w is known in closed form. The thruster inputs at the start,
/// middle and end of the step are samples of the parabola with the same mean, first and second
/// moment as w. RK4 then integrates the thrust exactly for every tau, and the limit tau -> 0 is
/// smooth.
struct MotorLag {
  static EffectInfo info() {
    return {"motor_lag",
            "first-order lag of the thrusters",
            {{"tau", "s", "time constant", 0, 0, 2, typical::constant(0.05)}},
            0,
            1};
  }
  template <typename T>
  static void actuate(const T* p, const T& h, T* states, StepInputs<T>& inputs) {
    const Remains<T> left = decay(p[0], h);
    for (int i = 0; i < inputs.thrusters[0].size(); ++i)
      if (!inputs.isAngle(i)) approach(commanded(inputs, i), left, i, states[i], inputs);
  }
};
GROUND_REGISTER_EFFECT(MotorLag)

/// Thrusters whose input changes at a constant rate until it is what is commanded, as a speed controller does
/// that limits its slew. The coordinate is 1/rate, which is zero where nothing limits it.
struct MotorRate {
  static EffectInfo info() {
    return {"motor_rate",
            "limited rate of the thrusters' inputs",
            {{"rate", "1/s", "at which an input changes", kUnbounded, 0.1, kUnbounded, typical::constant(0.1),
              Coordinate::kReciprocal}},
            0,
            1};
  }
  template <typename T>
  static void actuate(const T* p, const T& h, T* states, StepInputs<T>& inputs) {
    using std::abs;
    for (int i = 0; i < inputs.thrusters[0].size(); ++i) {
      if (inputs.isAngle(i)) continue;
      const T command = commanded(inputs, i);
      approach(command, ramp(T(p[0] * abs(T(states[i] - command))), h), i, states[i], inputs);
    }
  }
};
GROUND_REGISTER_EFFECT(MotorRate)

/// A motor that slows down in another time than it speeds up: two first-order lags, of which one holds while
/// the input grows in size and the other while it falls. Where both are the same it is motor_lag.
struct MotorRiseFall {
  static EffectInfo info() {
    const auto scale = typical::constant(0.05);
    EffectInfo info = {"motor_rise_fall",
                       "motor lags that differ for rise and fall",
                       {{"rise", "s", "time constant of speeding up", 0, 0, 2, scale},
                        {"fall", "s", "time constant of slowing down", 0, 0, 2, scale}},
                       0,
                       1,
                       [](const ThrusterLayout& layout) { return layout.any(isMotor); }};
    info.contains = "motor_lag";
    return info;
  }
  static bool isMotor(const Thruster& one) { return !one.isAngle() && !one.on_off; }
  template <typename T>
  static void actuate(const T* p, const T& h, T* states, StepInputs<T>& inputs) {
    const Remains<T> rising = decay(p[0], h), falling = decay(p[1], h);
    for (int i = 0; i < inputs.thrusters[0].size(); ++i)
      if (isMotor((*inputs.layout)[i])) riseOrFall(rising, falling, i, states[i], inputs);
  }
};
GROUND_REGISTER_EFFECT(MotorRiseFall)

/// On/off valves that open and close in first-order lags of their own. A dead time is that of input_delay.
struct ValveLag {
  static EffectInfo info() {
    const auto scale = typical::constant(0.02);
    return {"valve_lag",
            "valves that take time to open and to close",
            {{"open", "s", "time constant of opening", 0, 0, 2, scale},
             {"close", "s", "time constant of closing", 0, 0, 2, scale}},
            0,
            1,
            [](const ThrusterLayout& layout) {
              return layout.any([](const Thruster& one) { return one.on_off; });
            }};
  }
  template <typename T>
  static void actuate(const T* p, const T& h, T* states, StepInputs<T>& inputs) {
    const Remains<T> opening = decay(p[0], h), closing = decay(p[1], h);
    for (int i = 0; i < inputs.thrusters[0].size(); ++i)
      if ((*inputs.layout)[i].on_off) riseOrFall(opening, closing, i, states[i], inputs);
  }
};
GROUND_REGISTER_EFFECT(ValveLag)

/// First-order lag of a rudder or of a turning thruster.
struct AngleLag {
  static constexpr Effect::Hook kHook = Effect::kActuate;

  static EffectInfo info() {
    return {"angle_lag",
            "first-order lag of the angle of",
            {{"tau", "s", "time constant", 0, 0, 20, typical::constant(0.05)}},
            1};
  }
  static bool suits(const ThrusterLayout& layout, int channel) { return !layout.pushes(channel); }
  template <typename T>
  static void act(const T* p, const T& h, T* states, int channel, StepInputs<T>& inputs) {
    approach(commanded(inputs, channel), decay(p[0], h), channel, states[0], inputs);
  }
};
GROUND_REGISTER_THRUSTER_EFFECT(AngleLag)

/// A rudder or turning thruster that turns towards its command at a constant rate. The coordinate is 1/rate,
/// which is zero for one that turns at once.
struct AngleRate {
  static constexpr Effect::Hook kHook = Effect::kActuate;

  static EffectInfo info() {
    const double infinity = std::numeric_limits<double>::infinity();
    return {"angle_rate",
            "limited rate of the angle of",
            {{"rate", "rad/s", "at which it turns", infinity, 1e-3, infinity, typical::constant(0.1),
              Coordinate::kReciprocal}},
            1};
  }
  static bool suits(const ThrusterLayout& layout, int channel) { return !layout.pushes(channel); }
  template <typename T>
  static void act(const T* p, const T& h, T* states, int channel, StepInputs<T>& inputs) {
    using std::abs;
    const T command = commanded(inputs, channel);
    const double scale = std::abs((*inputs.layout)[channel].angle) * M_PI / 180;
    const T time = p[0] * scale * abs(T(states[0] - command));
    approach(command, ramp(time, h), channel, states[0], inputs);
  }
};
GROUND_REGISTER_THRUSTER_EFFECT(AngleRate)

/// A supply that sags under load and recovers: each input that acts is w (1 - part z), where z follows the
/// mean size of all inputs, relative to full input, with a time constant. The time does nothing where the
/// part is 0, and is short beside kActuatorMemory.
struct SupplySag {
  static EffectInfo info() {
    return {"supply_sag",
            "supply that sags under load and recovers",
            {{"part", "-", "part of an input that is lost under full load", 0, 0, 1, typical::constant(0.1)},
             {"time", "s", "time constant of sagging and recovering", 1, 0.02, 3, typical::constant(1.0),
              Coordinate::kValue, true}},
            1};
  }
  template <typename T>
  static void actuate(const T* p, const T& h, T* states, StepInputs<T>& inputs) {
    using std::abs;
    T load(0.0);
    for (int i = 0; i < inputs.thrusters[0].size(); ++i)
      if (!inputs.isAngle(i)) load += abs(commanded(inputs, i));
    load /= inputs.input_max * static_cast<double>(inputs.layout->forces());
    const std::array<T, 3> sag = moving(load, decay(p[1], h), states[0]);
    for (int i = 0; i < inputs.thrusters[0].size(); ++i)
      if (!inputs.isAngle(i)) weaken(p[0], sag, i, inputs);
  }
};
GROUND_REGISTER_EFFECT(SupplySag)

/// Thrusters that weaken while they work and recover, each by itself, such as one with a battery of its own
/// or one that gets warm: supply_sag with the load of each thruster alone.
struct ThrustDroop {
  static EffectInfo info() {
    return {"thrust_droop",
            "thrusters that weaken under their load",
            {{"part", "-", "part of an input that is lost at full load", 0, 0, 1, typical::constant(0.1)},
             {"time", "s", "time constant of weakening and recovering", 1, 0.02, 3, typical::constant(1.0),
              Coordinate::kValue, true}},
            0,
            1,
            [](const ThrusterLayout& layout) { return layout.forces() > 1; }};
  }
  template <typename T>
  static void actuate(const T* p, const T& h, T* states, StepInputs<T>& inputs) {
    using std::abs;
    const Remains<T> left = decay(p[1], h);
    for (int i = 0; i < inputs.thrusters[0].size(); ++i) {
      if (inputs.isAngle(i)) continue;
      const T load = abs(commanded(inputs, i)) / inputs.input_max;
      weaken(p[0], moving(load, left, states[i]), i, inputs);
    }
  }
};
GROUND_REGISTER_EFFECT(ThrustDroop)

/// A channel that does not answer small commands: u - sign(u) width beyond the width, else 0.
struct DeadBand {
  static constexpr Effect::Hook kHook = Effect::kActuate;

  static EffectInfo info() {
    return {"dead_band",
            "dead band of",
            {{"width", "-", "input without effect", 0, 0, 1, typical::constant(0.05)}}};
  }
  static bool suits(const ThrusterLayout& layout, int) { return layout.steers(); }
  template <typename T>
  static void act(const T* p, const T&, T*, int channel, StepInputs<T>& inputs) {
    using std::abs;
    for (Thrusters<T>& node : inputs.thrusters) {
      T& u = node(channel);
      const T beyond = notBelowZero(T(abs(u) - p[0]));
      u = select(u < 0.0, T(-beyond), beyond);
    }
  }
};
GROUND_REGISTER_THRUSTER_EFFECT(DeadBand)

/// Dead time between command and thrust: the craft acts on u(t - d).
struct InputDelay {
  static EffectInfo info() {
    return {"input_delay",
            "dead time between command and thrust",
            {{"delay", "s", "dead time", 0, 0, 1, typical::constant(0.02)}}};
  }
  template <typename T>
  static void delay(const T* p, T& seconds) {
    seconds += p[0];
  }
};
GROUND_REGISTER_EFFECT(InputDelay)

}  // namespace ground
