#include <cmath>

#include "ground/model/effect_registry.h"

namespace ground {

/// First-order lag of each thruster, dw/dt = (u - w)/tau, thrust from w.
///
/// The command is held over a step, so w is known in closed form. Its samples at start, middle and
/// end of the step are those of the parabola with the same mean, first and second moment: RK4 then
/// gets the impulse of the thrust exactly however short tau is, and the limit tau -> 0 is smooth.
struct MotorLag {
  static EffectInfo info() {
    return {"motor_lag",
            "first-order lag of the thrusters",
            {{"tau", "s", "time constant", 0, 0, 2, [](const Body<double>&) { return 0.05; }}},
            2};
  }
  template <typename T>
  static void actuate(const T* p, const T& h, T* states, StepInputs<T>& inputs) {
    std::array<T, 3> remains;  // what is left of the initial difference at the three nodes
    T end;
    decay(p[0], h, remains, end);
    for (int side = 0; side < 2; ++side) {
      const T command = inputs.thrusters[0](side);
      const T difference = states[side] - command;
      for (int i = 0; i < 3; ++i) inputs.thrusters[i](side) = command + difference * remains[i];
      states[side] = command + difference * end;
    }
  }

 private:
  template <typename T>
  static void decay(const T& tau, const T& h, std::array<T, 3>& nodes, T& end) {
    using std::exp;
    constexpr double kLong = 50, kShort = 0.02;  // of tau/h; beyond, the general case loses digits
    if (valueOf(tau) == 0 && valueOf(h) == 0) {
      end = T(0.0);
      nodes = {end, end, end};
      return;
    }
    if (valueOf(tau) > kLong * valueOf(h)) {
      end = exp(-h / tau);
      nodes = {T(1.0), exp(-h / (2.0 * tau)), end};
      return;
    }
    const T e = tau / h;
    end = valueOf(e) < kShort ? T(0.0) : T(exp(-1.0 / e));
    const T m0 = e * (1.0 - end), m1 = e * (m0 - end), m2 = e * (2.0 * m1 - end);
    const T c0 = m0, c1 = 3.0 * (2.0 * m1 - m0), c2 = 5.0 * (6.0 * m2 - 6.0 * m1 + m0);
    nodes = {c0 - c1 + c2, c0 - 0.5 * c2, c0 + c1 + c2};
  }
};
GROUND_REGISTER_EFFECT(MotorLag)

}  // namespace ground
