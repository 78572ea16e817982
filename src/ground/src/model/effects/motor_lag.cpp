#include "approach.h"
#include "ground/model/effect_registry.h"

namespace ground {

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
            {{"tau", "s", "time constant", 0, 0, 2, [](const Body<double>&) { return 0.05; }}},
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

}  // namespace ground
