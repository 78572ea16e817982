#pragma once

#include <Eigen/Core>
#include <array>
#include <cmath>
#include <optional>
#include <type_traits>

#include "ground/model/jet.h"
#include "ground/model/symbol.h"

namespace ground {

/// The model is instantiated for double, for Jet and for Symbol. More derivatives than these take several
/// passes.
constexpr int kDerivatives = 8;

inline double valueOf(double x) { return x; }
inline double valueOf(const Jet& x) { return x.a; }
/// With the values of the parameters; does not depend on anything else.
inline double valueOf(const Symbol& x) { return x.isConstant() ? x.value : Trace::current().valueOf(x); }

/// Sets the value and keeps the derivatives.
inline void setValue(double& x, double value) { x = value; }
inline void setValue(Jet& x, double value) { x.a = value; }

/// Whether all derivatives are zero.
inline bool isConstant(double) { return true; }
inline bool isConstant(const Jet& x) {
  for (int i = 0; i < kDerivatives; ++i)
    if (x.v[i] != 0) return false;
  return true;
}

inline bool isConstant(const Symbol& x) { return x.isConstant(); }

/// A number without derivatives that is given to a model, such as the input of the lift fan.
template <typename T>
using Given = std::conditional_t<std::is_same_v<T, Symbol>, Symbol, double>;

/// What acts on a craft beside the inputs of its thrusters and the time, at one instant. Who asks a model
/// says all of it: an unknown voltage is an explicit std::nullopt.
template <typename T>
struct Conditions {
  Given<T> lift;                  ///< input of the lift fan, 0..1
  std::optional<Given<T>> volts;  ///< voltage of the battery [V]; no value: not known

  Conditions(const Given<T>& lift_input, const std::optional<Given<T>>& battery)
      : lift(lift_input), volts(battery) {}
};

/// `a` where the condition holds, else `b`.
template <typename T>
const T& select(bool condition, const T& a, const T& b) {
  return condition ? a : b;
}
template <std::size_t count>
std::array<Symbol, count> select(const Condition& condition, const std::array<Symbol, count>& a,
                                 const std::array<Symbol, count>& b) {
  std::array<Symbol, count> chosen;
  for (std::size_t i = 0; i < count; ++i) chosen[i] = select(condition, a[i], b[i]);
  return chosen;
}

/// a() where the condition holds, else b(). Numbers compute only one of them.
template <class A, class B>
GROUND_INLINE auto choose(bool condition, const A& a, const B& b) {
  return condition ? a() : b();
}
template <class A, class B>
auto choose(const Condition& condition, const A& a, const B& b) {
  return select(condition, a(), b());
}

/// f(x) where x is above a number, else `otherwise`: f may have no derivative at that number, such as
/// a root or a power at 0. A formula of symbols computes f at another number there.
template <typename T, class F>
GROUND_INLINE T whereAbove(double number, const T& x, const F& f, const T& otherwise) {
  if constexpr (std::is_same_v<T, Symbol>) {
    const Condition above = x > number;
    return select(above, f(select(above, x, T(std::floor(number) + 1))), otherwise);
  } else {
    return x > number ? f(x) : otherwise;
  }
}

template <typename T>
using Vector2 = Eigen::Matrix<T, 2, 1>;
template <typename T>
using Vector3 = Eigen::Matrix<T, 3, 1>;
template <typename T>
using Matrix3 = Eigen::Matrix<T, 3, 3>;

/// Rigid-body state at one instant.
template <typename T>
struct RigidState {
  Vector3<T> eta = Vector3<T>::Zero();  ///< x, y [m], psi [rad], world_ned
  Vector3<T> nu = Vector3<T>::Zero();   ///< u, v [m/s], r [rad/s], body
};

/// Converts a state to another scalar type, without derivatives.
template <typename T>
RigidState<T> cast(const RigidState<double>& state) {
  return {state.eta.template cast<T>(), state.nu.template cast<T>()};
}

/// Rotation of planar vectors by the heading psi [rad], (2.1).
template <typename T>
struct Rotation {
  T c, s;

  Rotation() = default;  ///< uninitialised
  explicit Rotation(const T& psi) {
    using std::cos;
    using std::sin;
    c = cos(psi);
    s = sin(psi);
  }
  Vector2<T> toWorld(const Vector2<T>& a) const { return {c * a.x() - s * a.y(), s * a.x() + c * a.y()}; }
  Vector2<T> toBody(const Vector2<T>& a) const { return {c * a.x() + s * a.y(), c * a.y() - s * a.x()}; }
};

/// Body to world rotation of a planar vector by the heading psi [rad].
template <typename T>
Vector2<T> bodyToWorld(const T& psi, const Vector2<T>& a) {
  return Rotation<T>(psi).toWorld(a);
}

/// World to body rotation of a planar vector by the heading psi [rad].
template <typename T>
Vector2<T> worldToBody(const T& psi, const Vector2<T>& a) {
  return Rotation<T>(psi).toBody(a);
}

/// max(x, 0); its derivatives are 0 where x is not positive.
template <typename T>
T notBelowZero(const T& x) {
  return select(x > 0.0, x, T(0.0));
}

/// Angle wrapped to (-pi, pi] [rad].
inline double wrapAngle(double angle) {
  const double wrapped = std::remainder(angle, 2 * M_PI);
  return wrapped <= -M_PI ? wrapped + 2 * M_PI : wrapped;
}

}  // namespace ground
