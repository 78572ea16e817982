#include <cmath>

#include "approach.h"
#include "ground/model/effect_registry.h"

namespace ground {

/// Thrusters that weaken while they work and recover, each by itself, such as one with a battery of its own
/// or one that gets warm: supply_sag with the load of each thruster alone.
struct ThrustDroop {
  static EffectInfo info() {
    return {"thrust_droop",
            "thrusters that weaken under own load",
            {{"part", "-", "part of an input that is lost at full load", 0, 0, 1,
              [](const Body<double>&) { return 0.1; }},
             {"time", "s", "time constant of weakening and recovering", 1, 0.02, 3,
              [](const Body<double>&) { return 1.0; }, Coordinate::kValue, true}},
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

}  // namespace ground
