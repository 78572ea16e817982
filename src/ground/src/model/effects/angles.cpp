// Rudders, vanes and thrusters that turn.
#include <cmath>

#include "ground/model/effect_registry.h"
#include "ground/model/typical.h"

namespace ground {

/// A thruster that turns farther than its commands say, or less. A foil has foil_gain instead, which small
/// angles cannot distinguish from this.
struct AngleGain {
  static constexpr Effect::Hook kHook = Effect::kSteer;

  static EffectInfo info() {
    return {"angle_gain",
            "angle that turns too far or too little,",
            {{"a", "-", "relative change of its angle", 0, -1, 1, typical::constant(0.1)}}};
  }
  static bool suits(const ThrusterLayout& layout, int channel) {
    return layout[channel].kind == Thruster::Kind::kTurn;
  }
  template <typename T>
  static void act(const T* p, Steered<T>& angle) {
    angle.scale *= 1.0 + p[0];
  }
};
GROUND_REGISTER_THRUSTER_EFFECT(AngleGain)

/// A rudder or a turning thruster whose zero is elsewhere than the model has it.
struct AngleOffset {
  static constexpr Effect::Hook kHook = Effect::kSteer;

  static EffectInfo info() {
    return {"angle_offset",
            "wrong zero of the angle of",
            {{"angle", "rad", "added to its angle", 0, -M_PI, M_PI, typical::constant(0.1)}}};
  }
  static bool suits(const ThrusterLayout& layout, int channel) { return !layout.pushes(channel); }
  template <typename T>
  static void act(const T* p, Steered<T>& angle) {
    angle.offset += p[0];
  }
};
GROUND_REGISTER_THRUSTER_EFFECT(AngleOffset)

/// A rudder or vane whose force is smaller or larger than the model has it: c (1 + a).
struct FoilGain {
  static constexpr Effect::Hook kHook = Effect::kSteer;

  static EffectInfo info() {
    return {"foil_gain",
            "weak or strong foil",
            {{"a", "-", "relative change of its force", 0, -1, 20, typical::constant(0.1)}}};
  }
  static bool suits(const ThrusterLayout& layout, int channel) {
    return layout[channel].kind == Thruster::Kind::kFoil;
  }
  template <typename T>
  static void act(const T* p, Steered<T>& foil) {
    foil.force *= 1.0 + p[0];
  }
};
GROUND_REGISTER_THRUSTER_EFFECT(FoilGain)

/// How much of the craft's own motion reaches a foil, beside the stream of its thruster: a hull's wake slows
/// the flow, and straightens it. Changes own_speed^2 by `speed` and own_sway by `sway`.
struct FoilInflow {
  static constexpr Effect::Hook kHook = Effect::kSteer;

  static EffectInfo info() {
    return {"foil_inflow",
            "more or less of the craft's own motion at foil",
            {{"speed", "-", "added to the square of own_speed", 0, -4, 4, typical::constant(0.1)},
             {"sway", "-", "added to own_sway", 0, -2, 2, typical::constant(0.1)}}};
  }
  static bool suits(const ThrusterLayout& layout, int channel) {
    return layout[channel].kind == Thruster::Kind::kFoil;
  }
  template <typename T>
  static void act(const T* p, Steered<T>& foil) {
    foil.own_square += p[0];
    foil.own_sway += p[1];
  }
};
GROUND_REGISTER_THRUSTER_EFFECT(FoilInflow)

/// A foil behind a hull with one propeller meets more of the sway of one side than of the other, by the twist
/// of the stream: own_sway times 1 + a for flow from port, 1 - a from starboard (gamma_R of Yasukawa and
/// Yoshimura 2015).
struct FoilSide {
  static constexpr Effect::Hook kHook = Effect::kSteer;

  static EffectInfo info() {
    return EffectInfo{
        "foil_side",
        "flow that differs between both sides of foil",
        {{"a", "-", "relative part of own_sway, more from port", 0, -1, 1, typical::constant(0.1)}}}
        .of(Surroundings::kWater);
  }
  static bool suits(const ThrusterLayout& layout, int channel) {
    const Thruster& one = layout[channel];
    return one.kind == Thruster::Kind::kFoil && !one.foil.stream.empty() && one.foil.own_sway != 0;
  }
  template <typename T>
  static void act(const T* p, Steered<T>& foil) {
    foil.own_side += p[0];
  }
};
GROUND_REGISTER_THRUSTER_EFFECT(FoilSide)

}  // namespace ground
