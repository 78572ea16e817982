#include <cmath>

#include "ground/model/effect_registry.h"

namespace ground {

/// Thrusters that share a supply of air or current: the force of each falls with the inputs of the others,
/// F / (1 + s sum |u_j|).
struct SupplyDroop {
  static constexpr bool kUsesPose = false;

  static EffectInfo info() {
    return {"supply_droop",
            "thrust that falls as more thrusters work",
            {{"s", "-", "relative loss per other thruster at full input", 0, 0, 10,
              [](const Body<double>&) { return 0.05; }}},
            0,
            0,
            [](const ThrusterLayout& layout) { return layout.forces() > 2; }};
  }
  template <typename T>
  static void thrust(const T* p, const Point<T>& point, Thrusters<T>& force) {
    using std::abs;
    Thrusters<T> total = Thrusters<T>::zero(force.size());  // of each supply, at its first thruster
    for (int i = 0; i < force.size(); ++i)
      if (point.layout.pushes(i)) total(point.layout.supply(i)) += abs(point.input(i));
    for (int i = 0; i < force.size(); ++i)
      if (point.layout.pushes(i))
        force(i) = force(i) / (1.0 + p[0] * (total(point.layout.supply(i)) - abs(point.input(i))));
  }
};
GROUND_REGISTER_EFFECT(SupplyDroop)

}  // namespace ground
