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
    inputs.thrusters[0].forEach([&](int i) {
      const T command = inputs.thrusters[0](i);
      const T difference = states[i] - command;
      inputs.thrusters[0](i) = command + difference * left.start;
      inputs.thrusters[1](i) = command + difference * left.middle;
      inputs.thrusters[2](i) = command + difference * left.end;
      states[i] = command + difference * left.after;
    });
  }

 private:
  /// Fraction of the initial difference w - u that remains: at the three nodes of the parabola, and
  /// after the step.
  template <typename T>
  struct Remains {
    T start{0.0}, middle{0.0}, end{0.0}, after{0.0};

    template <class M>
    friend Remains blend(const M& mask, const Remains& a, const Remains& b) {
      return {blend(mask, a.start, b.start), blend(mask, a.middle, b.middle),
              blend(mask, a.end, b.end), blend(mask, a.after, b.after)};
    }
  };

  template <typename T>
  static Remains<T> decay(const T& tau, const T& h) {
    // Range of tau/h in which the general case is accurate.
    constexpr double kMaxRatio = 50, kMinRatio = 0.02;
    using std::exp;
    const auto slow = [&] {
      const T end = exp(-h / tau);
      return Remains<T>{T(1.0), T(exp(-h / (2.0 * tau))), end, end};
    };
    const auto general = [&] {
      const T e = tau / h;
      const T end =
          choose(valueOf(e) < kMinRatio, [] { return T(0.0); }, [&] { return T(exp(-1.0 / e)); });
      const T m0 = e * (1.0 - end), m1 = e * (m0 - end), m2 = e * (2.0 * m1 - end);
      const T c0 = m0, c1 = 3.0 * (2.0 * m1 - m0), c2 = 5.0 * (6.0 * m2 - 6.0 * m1 + m0);
      return Remains<T>{c0 - c1 + c2, c0 - 0.5 * c2, c0 + c1 + c2, end};
    };
    return choose(
        valueOf(tau) == 0.0 && valueOf(h) == 0.0, [] { return Remains<T>(); },
        [&] { return choose(valueOf(tau) > kMaxRatio * valueOf(h), slow, general); });
  }
};
GROUND_REGISTER_EFFECT(MotorLag)

}  // namespace ground
