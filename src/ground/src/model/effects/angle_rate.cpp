#include <cmath>
#include <limits>

#include "approach.h"
#include "ground/model/effect_registry.h"

namespace ground {

/// A rudder or turning thruster that turns towards its command at a constant rate. The coordinate is 1/rate,
/// which is zero for one that turns at once.
struct AngleRate {
  static constexpr Effect::Hook kHook = Effect::kActuate;

  static EffectInfo info() {
    const double infinity = std::numeric_limits<double>::infinity();
    return {"angle_rate",
            "limited rate of the angle of",
            {{"rate", "rad/s", "at which it turns", infinity, 1e-3, infinity,
              [](const Body<double>&) { return 0.1; }, Coordinate::kReciprocal}},
            1};
  }
  static bool suits(const ThrusterLayout& layout, int channel) { return !layout.pushes(channel); }
  template <typename T>
  static void act(const T* p, const T& h, T* states, int channel, StepInputs<T>& inputs) {
    using std::abs;
    const T command = commanded(inputs, channel);
    const double scale = std::abs((*inputs.layout)[channel].angle) * M_PI / 180;
    const T time = p[0] * scale * abs(T(states[0] - command));
    approach(command, ramp(time, h), channel, states[0], inputs);
  }
};
GROUND_REGISTER_THRUSTER_EFFECT(AngleRate)

}  // namespace ground
