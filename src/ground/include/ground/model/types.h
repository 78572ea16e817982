#pragma once

#include <Eigen/Core>
#include <cmath>
#include <iterator>

#include "ground/model/dual.h"
#include "ground/model/lanes.h"

namespace ground {

// The core is built for several kinds of processor and chosen when it is loaded, so all libraries
// must use the same alignment.
static_assert(EIGEN_DEFAULT_ALIGN_BYTES == 16,
              "Eigen allocates otherwise than the core does: compile without -march=native or AVX");

/// The model is instantiated for the scalar types double and Lanes (one and eight simulations) and
/// for these two, which carry eight derivatives. More derivatives take several passes.
using Jet = Dual<double, 8>;      ///< one simulation with derivatives
using LanesJet = Dual<Lanes, 8>;  ///< eight simulations with derivatives

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

/// Type of the value of T: T without derivatives.
template <typename T>
struct WithoutDerivatives {
  using type = T;
};
template <typename V, int N>
struct WithoutDerivatives<Dual<V, N>> {
  using type = V;
};
template <typename T>
using ValueOf = typename WithoutDerivatives<T>::type;

inline double valueOf(double x) { return x; }
inline const Lanes& valueOf(const Lanes& x) { return x; }
template <typename V, int N>
const V& valueOf(const Dual<V, N>& x) {
  return x.a;
}

/// Reference to the value of a variable.
inline double& valueIn(double& x) { return x; }
inline Lanes& valueIn(Lanes& x) { return x; }
template <typename V, int N>
V& valueIn(Dual<V, N>& x) {
  return x.a;
}

/// The same state with another scalar type, without derivatives.
template <typename T, typename V>
RigidState<T> cast(const RigidState<V>& state) {
  return {state.eta.template cast<T>(), state.nu.template cast<T>()};
}

inline void cosSin(double angle, double& c, double& s) {
  c = std::cos(angle);
  s = std::sin(angle);
}
inline void cosSin(const Lanes& angle, Lanes& c, Lanes& s) {
  c = cos(angle);
  s = sin(angle);
}
template <typename V, int N>
void cosSin(const Dual<V, N>& angle, Dual<V, N>& c, Dual<V, N>& s) {
  V cosine, sine;
  cosSin(angle.a, cosine, sine);
  c = chain(angle, cosine, V(-sine));
  s = chain(angle, sine, cosine);
}

/// cosSin(angle) from the cosine and sine of another angle that is `by` smaller [rad]. Where `by` is
/// small, as between stages of an integration step, their Taylor series are several times faster and
/// as accurate.
template <typename V>
GROUND_INLINE void cosSinBeside(const V& cosine, const V& sine, const V& by, const V& angle, V& c,
                                V& s) {
  constexpr double kSmall = 0.5;  // the first terms left out are below 3e-17
  const V square = by * by;
  if (!allOf(square < V(kSmall * kSmall))) return cosSin(angle, c, s);
  // 1 - x^2/d1 (1 - x^2/d2 (1 - ...))
  const auto series = [&](const auto& divisors) {
    V sum(1.0);
    for (int i = static_cast<int>(std::size(divisors)) - 1; i >= 0; --i)
      sum = V(1.0) - V(1 / divisors[i]) * square * sum;
    return sum;
  };
  constexpr double kCosine[] = {1 * 2, 3 * 4, 5 * 6, 7 * 8, 9 * 10, 11 * 12, 13 * 14};
  constexpr double kSine[] = {2 * 3, 4 * 5, 6 * 7, 8 * 9, 10 * 11, 12 * 13};
  const V cos_by = series(kCosine), sin_by = by * series(kSine);
  c = cosine * cos_by - sine * sin_by;
  s = sine * cos_by + cosine * sin_by;
}

/// Rotation of planar vectors by the heading psi [rad], (2.1).
template <typename T>
struct Rotation {
  T c, s;

  Rotation() = default;  ///< uninitialised
  explicit Rotation(const T& psi) { cosSin(psi, c, s); }
  /// From known values of the heading's cosine and sine; adds their derivatives.
  Rotation(const T& psi, const ValueOf<T>& cosine, const ValueOf<T>& sine) {
    if constexpr (std::is_same_v<T, ValueOf<T>>) {
      c = cosine;
      s = sine;
    } else {
      c = chain(psi, cosine, ValueOf<T>(-sine));
      s = chain(psi, sine, cosine);
    }
  }
  Vector2<T> toWorld(const Vector2<T>& a) const {
    return {c * a.x() - s * a.y(), s * a.x() + c * a.y()};
  }
  Vector2<T> toBody(const Vector2<T>& a) const {
    return {c * a.x() + s * a.y(), c * a.y() - s * a.x()};
  }
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

/// max(x, 0), lane by lane; its derivatives are 0 where x is not positive.
template <typename T>
GROUND_INLINE T notBelowZero(const T& x) {
  return choose(valueOf(x) > ValueOf<T>(0.0), [&] { return x; }, [] { return T(0.0); });
}

/// Angle wrapped to (-pi, pi] [rad].
inline double wrapAngle(double angle) {
  const double wrapped = std::remainder(angle, 2 * M_PI);
  return wrapped <= -M_PI ? wrapped + 2 * M_PI : wrapped;
}

}  // namespace ground
