// How an actuator approaches its command during a step, while the command is held.
#pragma once

#include <array>
#include <cmath>

#include "ground/model/effect.h"

namespace ground {

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

}  // namespace ground
