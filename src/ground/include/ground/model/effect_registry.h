#pragma once

#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "ground/model/effect.h"

namespace ground {

/// The effect of that name; throws std::invalid_argument naming all known ones.
EffectPtr makeEffect(const std::string& name);
/// Names of the effects of the library, in alphabetical order.
std::vector<std::string> effectNames();
/// Adds an effect to the library. Throws std::logic_error when the name is taken.
bool registerEffect(EffectPtr effect);

namespace detail {

/// Calls the hooks that struct E has; E has templates of the same names as EffectHooks.
#define GROUND_FORWARD_HOOK(Hook)                                           \
  template <class E, class... Args>                                         \
  auto call_##Hook(int, Args&&... args)                                     \
      -> decltype(E::Hook(std::forward<Args>(args)...), std::true_type()) { \
    E::Hook(std::forward<Args>(args)...);                                   \
    return {};                                                              \
  }                                                                         \
  template <class E, class... Args>                                         \
  std::false_type call_##Hook(long, Args&&...) {                            \
    return {};                                                              \
  }
GROUND_FORWARD_HOOK(delay)
GROUND_FORWARD_HOOK(actuate)
GROUND_FORWARD_HOOK(rates)
GROUND_FORWARD_HOOK(thrust)
GROUND_FORWARD_HOOK(air)
GROUND_FORWARD_HOOK(inertia)
GROUND_FORWARD_HOOK(wrench)
GROUND_FORWARD_HOOK(measure)
#undef GROUND_FORWARD_HOOK

/// Whether an effect's thrust or wrench depends on the pose; those that do not may say so.
template <class E, class = void>
struct UsesPose : std::true_type {};
template <class E>
struct UsesPose<E, std::void_t<decltype(E::kUsesPose)>> : std::bool_constant<E::kUsesPose> {};

template <class E, class T, class Base>
class HooksOf : public Base {
 public:
  void delay(const T* p, T& d) const override { call_delay<E>(0, p, d); }
  void actuate(const T* p, const T& h, T* states, StepInputs<T>& u) const override {
    call_actuate<E>(0, p, h, states, u);
  }
  void rates(const T* p, const Point<T>& s, T* d) const override { call_rates<E>(0, p, s, d); }
  void thrust(const T* p, const Point<T>& s, Vector2<T>& f) const override {
    call_thrust<E>(0, p, s, f);
  }
  void air(const T* p, Vector2<T>& w) const override { call_air<E>(0, p, w); }
  void inertia(const T* p, const Body<T>& b, Matrix3<T>& m) const override {
    call_inertia<E>(0, p, b, m);
  }
  void wrench(const T* p, const Point<T>& s, Vector3<T>& w) const override {
    call_wrench<E>(0, p, s, w);
  }
  void measure(const T* p, const Vector3<T>& eta, Measurement<T>& m) const override {
    call_measure<E>(0, p, eta, m);
  }
};

template <class E>
class EffectFrom final
    : public HooksOf<E, double, HooksOf<E, Jet, HooksOf<E, Lanes, HooksOf<E, LanesJet, Effect>>>>,
      public std::enable_shared_from_this<EffectFrom<E>> {
 public:
  const EffectInfo& info() const override {
    static const EffectInfo info = E::info();
    return info;
  }
  unsigned hooks() const override {
    using P = const double*;
    unsigned set = 0;
    const auto add = [&set](Effect::Hook hook, bool has) { set |= has ? hook : 0u; };
    add(Effect::kDelay, has<decltype(call_delay<E>(0, P(), std::declval<double&>()))>());
    add(Effect::kActuate,
        has<decltype(call_actuate<E>(0, P(), std::declval<const double&>(), std::declval<double*>(),
                                     std::declval<StepInputs<double>&>()))>());
    add(Effect::kRates, has<decltype(call_rates<E>(0, P(), std::declval<const Point<double>&>(),
                                                   std::declval<double*>()))>());
    add(Effect::kThrust, has<decltype(call_thrust<E>(0, P(), std::declval<const Point<double>&>(),
                                                     std::declval<Vector2<double>&>()))>());
    add(Effect::kAir, has<decltype(call_air<E>(0, P(), std::declval<Vector2<double>&>()))>());
    add(Effect::kInertia, has<decltype(call_inertia<E>(0, P(), std::declval<const Body<double>&>(),
                                                       std::declval<Matrix3<double>&>()))>());
    add(Effect::kWrench, has<decltype(call_wrench<E>(0, P(), std::declval<const Point<double>&>(),
                                                     std::declval<Vector3<double>&>()))>());
    add(Effect::kMeasure,
        has<decltype(call_measure<E>(0, P(), std::declval<const Vector3<double>&>(),
                                     std::declval<Measurement<double>&>()))>());
    const bool moves = set & (Effect::kThrust | Effect::kWrench | Effect::kRates);
    add(Effect::kPose, (set & Effect::kAir) || (moves && UsesPose<E>::value));
    return set;
  }
  std::shared_ptr<const Effect> forThread() const override { return this->shared_from_this(); }

 private:
  template <class Result>
  static constexpr bool has() {
    return Result::value;
  }
};

}  // namespace detail

/// Makes struct E an effect of the library. E has `static EffectInfo info()` and, as templates on
/// the scalar T, whichever static functions of EffectHooks it needs. One whose thrust and wrench do
/// not look at the pose may say `static constexpr bool kUsesPose = false`: fits to velocities are
/// faster then. See src/model/effects/.
#define GROUND_REGISTER_EFFECT(E)                                                    \
  namespace {                                                                        \
  [[maybe_unused]] const bool E##_registered =                                       \
      ::ground::registerEffect(std::make_shared<::ground::detail::EffectFrom<E>>()); \
  }

}  // namespace ground
