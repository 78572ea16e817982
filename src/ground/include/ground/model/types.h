#pragma once

#include <ceres/jet.h>

#include <Eigen/Core>
#include <cmath>

namespace ground {

/// Scalar that carries eight exact derivatives (forward mode). The model is instantiated for
/// double and Jet; more than eight derivatives are taken in several passes.
using Jet = ceres::Jet<double, 8>;

template <typename T>
using Vector2 = Eigen::Matrix<T, 2, 1>;
template <typename T>
using Vector3 = Eigen::Matrix<T, 3, 1>;
template <typename T>
using Matrix3 = Eigen::Matrix<T, 3, 3>;

inline double valueOf(double x) { return x; }
inline double valueOf(const Jet& x) { return x.a; }

inline void cosSin(double angle, double& c, double& s) {
  c = std::cos(angle);
  s = std::sin(angle);
}
/// Each is the other's derivative: Jet's own cos and sin would take both twice.
inline void cosSin(const Jet& angle, Jet& c, Jet& s) {
  cosSin(angle.a, c.a, s.a);
  c.v = -s.a * angle.v;
  s.v = c.a * angle.v;
}

/// Rotation of planar vectors by the heading psi [rad], (2.1).
template <typename T>
struct Rotation {
  T c{1.0}, s{0.0};

  Rotation() = default;
  explicit Rotation(const T& psi) { cosSin(psi, c, s); }
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

/// Angle wrapped to (-pi, pi] [rad].
inline double wrapAngle(double angle) {
  const double wrapped = std::remainder(angle, 2 * M_PI);
  return wrapped <= -M_PI ? wrapped + 2 * M_PI : wrapped;
}

}  // namespace ground
