#include <cmath>

#include "ground/model/effect_registry.h"

namespace ground {

/// Thrust that follows the voltage of the battery: k (V/V0)^p, where k holds at V0. A motor without load
/// turns in proportion to its voltage and thrust is the square of the speed, so that p is 2; resistance
/// and a loaded propeller make it less. The flight controller ArduPilot compensates by a mixture of p = 1
/// and p = 2 (AP_MotorsMulticopter, update_lift_max_from_batt_voltage). Without a voltage nothing changes:
/// battery_sag then follows the time. A diagnosis tries it where a voltage is recorded.
struct BatteryVoltage {
  static constexpr bool kUsesPose = false;

  static EffectInfo info() {
    return {"battery_voltage",
            "thrust that follows the battery voltage",
            {{"p", "-", "power of the voltage over that at which k holds", 0, 0, 5,
              [](const Body<double>&) { return 1.0; }}},
            0,
            0,
            nullptr,
            true};
  }
  template <typename T>
  static void thrust(const T* p, const Point<T>& point, Thrusters<T>& force) {
    using std::exp;
    if (!(point.body.volts > 0)) return;
    if constexpr (std::is_same_v<T, Symbol>) {
      force *= exp(p[0] * log(point.volts / point.body.volts));
      return;
    }
    const double ratio = point.body.volts > 0 ? valueOf(point.volts) / point.body.volts : 0;
    if (ratio > 0) force *= T(exp(p[0] * std::log(ratio)));
  }
};
GROUND_REGISTER_EFFECT(BatteryVoltage)

}  // namespace ground
