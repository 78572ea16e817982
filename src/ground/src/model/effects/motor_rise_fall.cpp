#include "approach.h"
#include "ground/model/effect_registry.h"

namespace ground {

/// A motor that slows down in another time than it speeds up: two first-order lags, of which one holds while
/// the input grows in size and the other while it falls. Where both are the same it is motor_lag.
struct MotorRiseFall {
  static EffectInfo info() {
    const auto typical = [](const Body<double>&) { return 0.05; };
    EffectInfo info = {"motor_rise_fall",
                       "motor lags that differ for rise and fall",
                       {{"rise", "s", "time constant of speeding up", 0, 0, 2, typical},
                        {"fall", "s", "time constant of slowing down", 0, 0, 2, typical}},
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

}  // namespace ground
