#include <array>
#include <cmath>

#include "ground/model/effect_registry.h"

namespace ground {

/// First-order lag of each thruster, dw/dt = (u - w)/tau, thrust from w.
///
/// The command is held over a step, so w is known in closed form. The thruster inputs at the start,
/// middle and end of the step are samples of the parabola with the same mean, first and second
/// moment as w. RK4 then integrates the thrust exactly for every tau, and the limit tau -> 0 is
/// smooth.
struct MotorLag {
  static EffectInfo info() {
    return {"motor_lag",
            "first-order lag of the thrusters",
            {{"tau", "s", "time constant", 0, 0, 2, [](const Body<double>&) { return 0.05; }}},
            0,
            {},
            false,
            nullptr,
            1};
  }
  template <typename T>
  static void actuate(const T* p, const T& h, T* states, StepInputs<T>& inputs) {
    const Remains<T> left = decay(p[0], h);
    const T &at_start = left[0], &at_middle = left[1], &at_end = left[2], &after = left[3];
    for (int i = 0; i < inputs.thrusters[0].size(); ++i) {
      const T command = inputs.thrusters[0](i);
      const T difference = states[i] - command;
      inputs.thrusters[0](i) = command + difference * at_start;
      inputs.thrusters[1](i) = command + difference * at_middle;
      inputs.thrusters[2](i) = command + difference * at_end;
      states[i] = command + difference * after;
    }
  }

 private:
  /// Fraction of the initial difference w - u that remains: at the three nodes of the parabola, and
  /// after the step.
  template <typename T>
  using Remains = std::array<T, 4>;

  template <typename T>
  static Remains<T> decay(const T& tau, const T& h) {
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
      const T c0 = m0, c1 = 3.0 * (2.0 * m1 - m0), c2 = 5.0 * (6.0 * m2 - 6.0 * m1 + m0);
      return Remains<T>{T(c0 - c1 + c2), T(c0 - 0.5 * c2), T(c0 + c1 + c2), end};
    };
    return choose(tau == 0.0 && h == 0.0, none, [&] { return choose(tau > kMaxRatio * h, slow, any); });
  }
};
GROUND_REGISTER_EFFECT(MotorLag)

}  // namespace ground
