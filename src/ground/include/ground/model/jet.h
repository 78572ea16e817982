#pragma once

#include <Eigen/Core>
#include <cmath>

#define GROUND_INLINE inline __attribute__((always_inline))

namespace ground {

/// Eight derivatives, in as few registers as the processor for which it is compiled has for them. Its
/// layout does not depend on the processor.
class Derivatives {
 public:
  Derivatives() {}  ///< not initialised
  double& operator[](int i) { return reinterpret_cast<double*>(parts_)[i]; }
  double operator[](int i) const { return reinterpret_cast<const double*>(parts_)[i]; }
  /// The first `count`, as a column.
  template <int count>
  auto head() const {
    return Eigen::Map<const Eigen::Matrix<double, 8, 1>>(reinterpret_cast<const double*>(parts_))
        .template head<count>();
  }
  /// Replaces each part by f(part, part of b).
  template <class Function>
  GROUND_INLINE Derivatives with(const Derivatives& b, const Function& f) const {
    Derivatives result;
    for (int i = 0; i < kParts; ++i) result.parts_[i] = f(parts_[i], b.parts_[i]);
    return result;
  }
  GROUND_INLINE static Derivatives zero() {
    Derivatives result;
    for (int i = 0; i < kParts; ++i) result.parts_[i] = Register{};
    return result;
  }
  friend GROUND_INLINE Derivatives operator+(const Derivatives& a, const Derivatives& b) {
    return a.with(b, [](auto x, auto y) { return x + y; });
  }
  friend GROUND_INLINE Derivatives operator-(const Derivatives& a, const Derivatives& b) {
    return a.with(b, [](auto x, auto y) { return x - y; });
  }
  friend GROUND_INLINE Derivatives operator*(double s, const Derivatives& a) {
    return a.with(a, [s](auto x, auto) { return s * x; });
  }
  Derivatives& operator+=(const Derivatives& b) { return *this = *this + b; }

 private:
#if defined(__AVX512F__)
  static constexpr int kBytes = 64;
#elif defined(__AVX__)
  static constexpr int kBytes = 32;
#else
  static constexpr int kBytes = 16;
#endif
  static constexpr int kParts = 64 / kBytes;
  typedef double Register __attribute__((vector_size(kBytes), aligned(16), may_alias));
  Register parts_[kParts];
};

/// A number with eight exact derivatives, for forward-mode automatic differentiation: a + v_1 e_1 + ...
/// + v_8 e_8 with e_i e_j = 0. Arithmetic follows from that rule (Griewank and Walther, Evaluating
/// Derivatives, 2008, chapter 3):
///
///     (a + v) + (b + w) = (a + b) + (v + w)
///     (a + v) * (b + w) = a b + (a w + b v)
///     f(a + v)          = f(a) + f'(a) v
///
/// Like a double, a Jet is not initialised by default.
struct Jet {
  double a;       ///< value
  Derivatives v;  ///< derivatives

  Jet() = default;
  /// Member by member: a processor waits to load derivatives that have been copied in other pieces.
  GROUND_INLINE Jet(const Jet& other) : a(other.a), v(other.v) {}
  GROUND_INLINE Jet& operator=(const Jet& other) {
    a = other.a;
    v = other.v;
    return *this;
  }
  GROUND_INLINE Jet(double value) : a(value), v(Derivatives::zero()) {}  // NOLINT: as numbers do
  /// The i-th variable: its i-th derivative is 1, the others are 0.
  Jet(double value, int i) : Jet(value) { v[i] = 1; }
  GROUND_INLINE Jet(double value, const Derivatives& derivatives) : a(value), v(derivatives) {}

  GROUND_INLINE Jet operator-() const { return {-a, -1.0 * v}; }
  GROUND_INLINE Jet& operator+=(const Jet& y) { return *this = *this + y; }
  GROUND_INLINE Jet& operator-=(const Jet& y) { return *this = *this - y; }
  GROUND_INLINE Jet& operator*=(const Jet& y) { return *this = *this * y; }
  GROUND_INLINE Jet& operator/=(const Jet& y) { return *this = *this / y; }

  friend GROUND_INLINE Jet operator+(const Jet& x, const Jet& y) { return {x.a + y.a, x.v + y.v}; }
  friend GROUND_INLINE Jet operator+(const Jet& x, double s) { return {x.a + s, x.v}; }
  friend GROUND_INLINE Jet operator+(double s, const Jet& x) { return {s + x.a, x.v}; }
  friend GROUND_INLINE Jet operator-(const Jet& x, const Jet& y) { return {x.a - y.a, x.v - y.v}; }
  friend GROUND_INLINE Jet operator-(const Jet& x, double s) { return {x.a - s, x.v}; }
  friend GROUND_INLINE Jet operator-(double s, const Jet& x) { return {s - x.a, -1.0 * x.v}; }
  friend GROUND_INLINE Jet operator*(const Jet& x, const Jet& y) {
    return {x.a * y.a, x.a * y.v + y.a * x.v};
  }
  friend GROUND_INLINE Jet operator*(const Jet& x, double s) { return {x.a * s, s * x.v}; }
  friend GROUND_INLINE Jet operator*(double s, const Jet& x) { return {s * x.a, s * x.v}; }
  friend GROUND_INLINE Jet operator/(const Jet& x, const Jet& y) {
    const double over = 1 / y.a, quotient = x.a * over;
    return {quotient, over * (x.v - quotient * y.v)};
  }
  friend GROUND_INLINE Jet operator/(const Jet& x, double s) { return x * (1 / s); }
  friend GROUND_INLINE Jet operator/(double s, const Jet& x) { return Jet(s) / x; }

  friend bool operator<(const Jet& x, const Jet& y) { return x.a < y.a; }
  friend bool operator>(const Jet& x, const Jet& y) { return x.a > y.a; }
  friend bool operator<=(const Jet& x, const Jet& y) { return x.a <= y.a; }
  friend bool operator>=(const Jet& x, const Jet& y) { return x.a >= y.a; }
  friend bool operator==(const Jet& x, const Jet& y) { return x.a == y.a; }
  friend bool operator!=(const Jet& x, const Jet& y) { return x.a != y.a; }
};

inline Jet abs(const Jet& x) { return x.a < 0 ? -x : x; }
GROUND_INLINE Jet sqrt(const Jet& x) {
  const double root = std::sqrt(x.a);
  return {root, 0.5 / root * x.v};
}
inline Jet exp(const Jet& x) {
  const double value = std::exp(x.a);
  return {value, value * x.v};
}
inline Jet log(const Jet& x) { return {std::log(x.a), 1 / x.a * x.v}; }
inline Jet sin(const Jet& x) { return {std::sin(x.a), std::cos(x.a) * x.v}; }
inline Jet cos(const Jet& x) { return {std::cos(x.a), -std::sin(x.a) * x.v}; }
inline Jet tanh(const Jet& x) {
  const double value = std::tanh(x.a);
  return {value, (1 - value * value) * x.v};
}
/// The base must be positive.
inline Jet pow(const Jet& base, const Jet& exponent) {
  const double value = std::pow(base.a, exponent.a);
  return {value, value * exponent.a / base.a * base.v + value * std::log(base.a) * exponent.v};
}
inline bool isfinite(const Jet& x) { return std::isfinite(x.a); }

}  // namespace ground

namespace Eigen {
template <>
struct NumTraits<ground::Jet> : NumTraits<double> {
  using Real = ground::Jet;
  using NonInteger = ground::Jet;
  using Nested = ground::Jet;
  enum { RequireInitialization = 1 };
};
}  // namespace Eigen
