#pragma once

#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "ground/model/effect.h"

namespace ground {

/// The effect of that name. Throws std::invalid_argument that names all known effects if there is
/// none. Effects of other packages come from the libraries that the environment variable
/// GROUND_EFFECT_LIBRARIES lists (paths or names for the loader, separated by colons); the first
/// call loads them. Throws std::runtime_error if one of them cannot be used.
/// An effect of a single thruster is named EFFECT_THRUSTER, such as thruster_gain_front_left; the
/// layout must list that thruster.
EffectPtr makeEffect(const std::string& name, const ThrusterLayout& layout = *thrusterPair());
/// Names of the effects of the library for such a craft, in alphabetical order, effects of single
/// thrusters last. Throws as makeEffect does.
std::vector<std::string> effectNames(const ThrusterLayout& layout = *thrusterPair());
/// Adds an effect to the library; a static object calls it (GROUND_REGISTER_EFFECT). Errors, such
/// as a duplicate name, are thrown later by makeEffect and effectNames, because what a library
/// throws while it is loaded cannot be caught.
bool registerEffect(EffectPtr effect);
/// Adds an effect of a single thruster: `make` gives it for thruster number i under a name
/// (GROUND_REGISTER_THRUSTER_EFFECT).
/// It gives nullptr if that one cannot have the effect.
using MakeThrusterEffect = EffectPtr (*)(int thruster, const ThrusterLayout& layout);
bool registerThrusterEffect(const std::string& name, MakeThrusterEffect make);

namespace detail {

/// Type of a pointer to the static function that may stand for a member function of EffectHooks.
template <class Member>
struct StaticOf;
template <class Hooks, class... Args>
struct StaticOf<void (Hooks::*)(Args...) const> {
  using Type = void (*)(Args...);
};
template <class Member>
using Static = typename StaticOf<Member>::Type;

/// For each hook: Has_ says whether struct E has a member of that name (the name is ambiguous in a
/// class that inherits it from E and from Named_). Fits_ says whether that member is a hook for
/// scalar T. call_ calls it.
#define GROUND_HOOK(Hook)                                                                                   \
  struct Named_##Hook {                                                                                     \
    int Hook;                                                                                               \
  };                                                                                                        \
  template <class E>                                                                                        \
  struct Both_##Hook : E, Named_##Hook {};                                                                  \
  template <class E, class = void>                                                                          \
  struct Has_##Hook : std::true_type {};                                                                    \
  template <class E>                                                                                        \
  struct Has_##Hook<E, std::void_t<decltype(&Both_##Hook<E>::Hook)>> : std::false_type {};                  \
  template <class E, class T, class = void>                                                                 \
  struct Fits_##Hook : std::false_type {};                                                                  \
  template <class E, class T>                                                                               \
  struct Fits_##Hook<E, T,                                                                                  \
                     std::void_t<decltype(static_cast<Static<decltype(&EffectHooks<T>::Hook)>>(&E::Hook))>> \
      : std::true_type {};                                                                                  \
  template <class E, class T, class... Args>                                                                \
  void call_##Hook(Args&&... args) {                                                                        \
    if constexpr (Has_##Hook<E>::value) {                                                                   \
      static_assert(Fits_##Hook<E, T>::value,                                                               \
                    "the effect's " #Hook                                                                   \
                    " must be a public static function, a template on the scalar T, with the "              \
                    "parameters of ground::EffectHooks<T>::" #Hook " (ground/model/effect.h)");             \
      if constexpr (Fits_##Hook<E, T>::value) E::Hook(std::forward<Args>(args)...);                         \
    }                                                                                                       \
  }
GROUND_HOOK(delay)
GROUND_HOOK(steer)
GROUND_HOOK(actuate)
GROUND_HOOK(rates)
GROUND_HOOK(thrust)
GROUND_HOOK(air)
GROUND_HOOK(inertia)
GROUND_HOOK(wrench)
GROUND_HOOK(measure)
#undef GROUND_HOOK

/// Whether an effect's thrust or wrench depends on the pose: true unless E::kUsesPose is false.
template <class E, class = void>
struct UsesPose : std::true_type {};
template <class E>
struct UsesPose<E, std::void_t<decltype(E::kUsesPose)>> : std::bool_constant<E::kUsesPose> {};

/// The hooks that struct E has (a set of Effect::Hook).
template <class E>
constexpr unsigned hooksOf() {
  unsigned set = 0;
  if (Has_delay<E>::value) set |= Effect::kDelay;
  if (Has_actuate<E>::value) set |= Effect::kActuate;
  if (Has_steer<E>::value) set |= Effect::kSteer;
  if (Has_rates<E>::value) set |= Effect::kRates;
  if (Has_thrust<E>::value) set |= Effect::kThrust;
  if (Has_air<E>::value) set |= Effect::kAir;
  if (Has_inertia<E>::value) set |= Effect::kInertia;
  if (Has_wrench<E>::value) set |= Effect::kWrench;
  if (Has_measure<E>::value) set |= Effect::kMeasure;
  const bool moves = set & (Effect::kThrust | Effect::kWrench | Effect::kRates);
  if ((set & Effect::kAir) || (moves && UsesPose<E>::value)) set |= Effect::kPose;
  return set;
}

template <class E, class T, class Base>
class HooksOf : public Base {
 public:
  void delay(const T* p, T& d) const override { call_delay<E, T>(p, d); }
  void steer(const T* p, std::vector<Steered<T>>& a) const override { call_steer<E, T>(p, a); }
  void actuate(const T* p, const T& h, T* states, StepInputs<T>& u) const override {
    call_actuate<E, T>(p, h, states, u);
  }
  void rates(const T* p, const Point<T>& s, T* d) const override { call_rates<E, T>(p, s, d); }
  void thrust(const T* p, const Point<T>& s, Thrusters<T>& f) const override { call_thrust<E, T>(p, s, f); }
  void air(const T* p, Vector2<T>& w) const override { call_air<E, T>(p, w); }
  void inertia(const T* p, const Body<T>& b, Matrix3<T>& m) const override { call_inertia<E, T>(p, b, m); }
  void wrench(const T* p, const Point<T>& s, Vector3<T>& w) const override { call_wrench<E, T>(p, s, w); }
  void measure(const T* p, const Vector3<T>& eta, Measurement<T>& m) const override {
    call_measure<E, T>(p, eta, m);
  }
};

template <class E>
class EffectFrom final : public HooksOf<E, double, HooksOf<E, Jet, HooksOf<E, Symbol, Effect>>> {
 public:
  const EffectInfo& info() const override {
    static const EffectInfo info = E::info();
    return info;
  }
  unsigned hooks() const override {
    static_assert(hooksOf<E>() != 0,
                  "the effect acts nowhere: it has none of the functions of ground::EffectHooks");
    return hooksOf<E>();
  }
};

/// The effect E of one thruster, which tells E::act() its number.
template <class E, class T, class Base>
class ThrusterHooks : public Base {
 public:
  void thrust(const T* p, const Point<T>& s, Thrusters<T>& f) const override {
    if constexpr (E::kHook == Effect::kThrust) E::act(p, s, this->thruster_, f);
  }
  void wrench(const T* p, const Point<T>& s, Vector3<T>& w) const override {
    if constexpr (E::kHook == Effect::kWrench) E::act(p, s, this->thruster_, w);
  }
  void steer(const T* p, std::vector<Steered<T>>& all) const override {
    if constexpr (E::kHook == Effect::kSteer) E::act(p, all[static_cast<std::size_t>(this->thruster_)]);
  }
  void actuate(const T* p, const T& h, T* states, StepInputs<T>& inputs) const override {
    if constexpr (E::kHook == Effect::kActuate) E::act(p, h, states, this->thruster_, inputs);
  }
};

/// Which channels have the effect E: E::suits, by default forces, of which the craft has several.
template <class E, class = void>
struct ThrusterSuits {
  static bool in(const ThrusterLayout& layout, int thruster) {
    return layout.pushes(thruster) && layout.forces() > 1;
  }
};
template <class E>
struct ThrusterSuits<E, std::void_t<decltype(&E::suits)>> {
  static bool in(const ThrusterLayout& layout, int thruster) { return E::suits(layout, thruster); }
};

class OfThruster : public Effect {
 protected:
  int thruster_ = 0;
};

template <class E>
class ThrusterEffect final
    : public ThrusterHooks<E, double, ThrusterHooks<E, Jet, ThrusterHooks<E, Symbol, OfThruster>>> {
 public:
  ThrusterEffect(int thruster, const ThrusterLayout& layout) : info_(E::info()) {
    this->thruster_ = thruster;
    info_.name += '_' + layout[thruster].name;
    info_.summary += ' ' + layout[thruster].name;
  }
  static EffectPtr make(int thruster, const ThrusterLayout& layout) {
    if (!ThrusterSuits<E>::in(layout, thruster)) return nullptr;
    return std::make_shared<ThrusterEffect>(thruster, layout);
  }
  const EffectInfo& info() const override { return info_; }
  unsigned hooks() const override { return E::kHook; }

 private:
  EffectInfo info_;
};

}  // namespace detail

/// Makes struct E an effect of each single thruster. E has `static EffectInfo info()`, with a summary
/// to which the thruster's name is added, `static constexpr Effect::Hook kHook`, and act(), a template on
/// the scalar T that does not look at the pose:
///
///     kThrust, kWrench   act(p, point, thruster, force or wrench)
///     kSteer             act(p, the Steered of that channel)
///     kActuate           act(p, h, the effect's states, thruster, step inputs)
///
/// `static bool suits(layout, thruster)`, if it has one, says which channels have the effect; by default
/// all channels of forces. See ThrusterGain in src/model/effects/thrust.cpp.
#define GROUND_REGISTER_THRUSTER_EFFECT(E)                                                          \
  namespace {                                                                                       \
  [[maybe_unused]] const bool E##_registered =                                                      \
      ::ground::registerThrusterEffect(E::info().name, &::ground::detail::ThrusterEffect<E>::make); \
  }

/// Makes struct E an effect of the library. E has `static EffectInfo info()` and the static
/// functions of EffectHooks that it needs, as templates on the scalar T. If its thrust and wrench
/// do not depend on the pose, it may define `static constexpr bool kUsesPose = false`: fits to
/// velocities are then faster. A function with the name of a hook but other parameters does not
/// compile. See src/model/effects/.
#define GROUND_REGISTER_EFFECT(E)                                                    \
  namespace {                                                                        \
  [[maybe_unused]] const bool E##_registered =                                       \
      ::ground::registerEffect(std::make_shared<::ground::detail::EffectFrom<E>>()); \
  }

}  // namespace ground
