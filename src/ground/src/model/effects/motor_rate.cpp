#include <cmath>

#include "approach.h"
#include "ground/model/effect_registry.h"

namespace ground {

/// Thrusters whose input changes at a constant rate until it is what is commanded, as a speed controller does
/// that limits its slew. The coordinate is 1/rate, which is zero where nothing limits it.
struct MotorRate {
  static EffectInfo info() {
    return {"motor_rate",
            "limited rate of the thrusters' inputs",
            {{"rate", "1/s", "at which an input changes", kUnbounded, 0.1, kUnbounded,
              [](const Body<double>&) { return 0.1; }, Coordinate::kReciprocal}},
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

}  // namespace ground
