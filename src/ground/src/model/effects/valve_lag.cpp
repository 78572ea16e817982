#include "approach.h"
#include "ground/model/effect_registry.h"

namespace ground {

/// On/off valves that open and close in first-order lags of their own. A dead time is that of input_delay.
struct ValveLag {
  static EffectInfo info() {
    const auto typical = [](const Body<double>&) { return 0.02; };
    return {"valve_lag",
            "valves that take time to open and to close",
            {{"open", "s", "time constant of opening", 0, 0, 2, typical},
             {"close", "s", "time constant of closing", 0, 0, 2, typical}},
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

}  // namespace ground
