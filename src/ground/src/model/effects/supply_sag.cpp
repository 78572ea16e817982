#include <cmath>

#include "approach.h"
#include "ground/model/effect_registry.h"

namespace ground {

/// A supply that sags under load and recovers: each input that acts is w (1 - part z), where z follows the
/// mean size of all inputs, relative to full input, with a time constant. The time does nothing where the
/// part is 0, and is short beside kActuatorMemory.
struct SupplySag {
  static EffectInfo info() {
    return {"supply_sag",
            "supply that sags under load and recovers",
            {{"part", "-", "part of an input that is lost under full load", 0, 0, 1,
              [](const Body<double>&) { return 0.1; }},
             {"time", "s", "time constant of sagging and recovering", 1, 0.02, 3,
              [](const Body<double>&) { return 1.0; }, Coordinate::kValue, true}},
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

}  // namespace ground
