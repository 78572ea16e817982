#pragma once

#include <Eigen/Core>
#include <cmath>

#include "ground/model/jet.h"

namespace ground {

/// The model is instantiated for double and for Jet. More derivatives than these take several passes.
constexpr int kDerivatives = 8;

inline double valueOf(double x) { return x; }
inline double valueOf(const Jet& x) { return x.a; }

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
  return x > 0.0 ? x : T(0.0);
}

/// Angle wrapped to (-pi, pi] [rad].
inline double wrapAngle(double angle) {
  const double wrapped = std::remainder(angle, 2 * M_PI);
  return wrapped <= -M_PI ? wrapped + 2 * M_PI : wrapped;
}

}  // namespace ground
