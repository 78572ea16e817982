#pragma once

#include <Eigen/Core>
#include <cmath>
#include <type_traits>

#include "ground/model/lanes.h"

namespace ground {

/// N derivatives of a value of type V.
template <typename V, int N>
struct Directions {
  static_assert(N > 0, "");
  V x[N];

  V& operator[](int i) { return x[i]; }
  const V& operator[](int i) const { return x[i]; }
  template <class Binary>
  GROUND_INLINE static Directions each(const Binary& of) {
    Directions result;
    for (int i = 0; i < N; ++i) result.x[i] = of(i);
    return result;
  }
  /// By single stores: the compiler clears a large block otherwise by an instruction that takes longer.
  static GROUND_INLINE Directions zero() {
    return each([](int) { return V(0.0); });
  }
  friend GROUND_INLINE Directions operator+(const Directions& a, const Directions& b) {
    return each([&](int i) { return a.x[i] + b.x[i]; });
  }
  friend GROUND_INLINE Directions operator-(const Directions& a, const Directions& b) {
    return each([&](int i) { return a.x[i] - b.x[i]; });
  }
  friend GROUND_INLINE Directions operator*(const V& a, const Directions& b) {
    return each([&](int i) { return a * b.x[i]; });
  }
};

/// Eight derivatives of a number fill one register.
template <>
struct Directions<double, 8> {
  Vec8 x;

  double& operator[](int i) { return reinterpret_cast<double*>(&x)[i]; }
  double operator[](int i) const { return registers::at(x, i); }
  template <int count>
  auto head() const {
    return Eigen::Map<const Eigen::Matrix<double, 8, 1>>(reinterpret_cast<const double*>(&x))
        .template head<count>();
  }
  GROUND_INLINE static Directions of(const Vec8& x) { return {x}; }
  static GROUND_INLINE Directions zero() { return of(Vec8{}); }
  friend GROUND_INLINE Directions operator+(const Directions& a, const Directions& b) {
    return of(a.x + b.x);
  }
  friend GROUND_INLINE Directions operator-(const Directions& a, const Directions& b) {
    return of(a.x - b.x);
  }
  friend GROUND_INLINE Directions operator*(double a, const Directions& b) { return of(a * b.x); }
};

/// A number with N exact derivatives, for forward-mode automatic differentiation.
///
/// A Dual is a + v_1 e_1 + ... + v_N e_N with e_i e_j = 0. Arithmetic follows from that rule:
///
///     (a + v) + (b + w) = (a + b) + (v + w)
///     (a + v) * (b + w) = a b + (a w + b v)
///     f(a + v)          = f(a) + f'(a) v
///
/// so v always holds the derivatives of a by the N chosen variables. Example: x^2 y at (3, 2),
///
///     const Dual<double, 2> x(3.0, 0), y(2.0, 1);  // variables 0 and 1
///     const Dual<double, 2> f = x * x * y;         // f.a = 18, f.v[0] = 12, f.v[1] = 9
///
/// V is double or Lanes. The default constructor leaves the number uninitialised, like a double.
/// Do not use Dual in dynamic Eigen vectors: their allocation does not align it.
template <typename V, int N>
struct Dual {
  using Value = V;
  static constexpr int kDirections = N;

  V a;                 ///< value
  Directions<V, N> v;  ///< derivatives

  Dual() = default;
  GROUND_INLINE Dual(const V& value)  // NOLINT: as numbers do
      : a(value), v(Directions<V, N>::zero()) {}
  template <class S, class = std::enable_if_t<std::is_arithmetic_v<S>>>
  GROUND_INLINE Dual(S value) : Dual(V(static_cast<double>(value))) {}  // NOLINT
  /// The i-th variable: its i-th derivative is 1, the others are 0.
  Dual(double value, int i) : Dual(V(value)) { v[i] = 1.0; }
  GROUND_INLINE Dual(const V& value, const Directions<V, N>& derivatives)
      : a(value), v(derivatives) {}
  // Copied by its members: the compiler copies whole blocks otherwise, with the gap between them, which
  // waits for numbers that were just stored one by one.
  GROUND_INLINE Dual(const Dual& other) noexcept : a(other.a), v(other.v) {}
  GROUND_INLINE Dual& operator=(const Dual& other) noexcept {
    a = other.a;
    v = other.v;
    return *this;
  }

  bool isConstant() const {
    for (int i = 0; i < N; ++i)
      if (!isZero(v[i])) return false;
    return true;
  }

  GROUND_INLINE Dual operator-() const { return {-a, V(-1.0) * v}; }
  GROUND_INLINE Dual& operator+=(const Dual& b) { return *this = *this + b; }
  GROUND_INLINE Dual& operator-=(const Dual& b) { return *this = *this - b; }
  GROUND_INLINE Dual& operator*=(const Dual& b) { return *this = *this * b; }
  GROUND_INLINE Dual& operator/=(const Dual& b) { return *this = *this / b; }

  friend GROUND_INLINE Dual operator+(const Dual& x, const Dual& y) {
    return {x.a + y.a, x.v + y.v};
  }
  friend GROUND_INLINE Dual operator-(const Dual& x, const Dual& y) {
    return {x.a - y.a, x.v - y.v};
  }
  friend GROUND_INLINE Dual operator*(const Dual& x, const Dual& y) {
    return {x.a * y.a, x.a * y.v + y.a * x.v};
  }
  friend GROUND_INLINE Dual operator/(const Dual& x, const Dual& y) {
    const V over = V(1.0) / y.a, quotient = x.a * over;
    return {quotient, over * (x.v - quotient * y.v)};
  }
  friend GROUND_INLINE Dual operator+(const Dual& x, const V& s) { return {x.a + s, x.v}; }
  friend GROUND_INLINE Dual operator+(const V& s, const Dual& x) { return {s + x.a, x.v}; }
  friend GROUND_INLINE Dual operator-(const Dual& x, const V& s) { return {x.a - s, x.v}; }
  friend GROUND_INLINE Dual operator-(const V& s, const Dual& x) {
    return {s - x.a, V(-1.0) * x.v};
  }
  friend GROUND_INLINE Dual operator*(const Dual& x, const V& s) { return {x.a * s, s * x.v}; }
  friend GROUND_INLINE Dual operator*(const V& s, const Dual& x) { return {s * x.a, s * x.v}; }
  friend GROUND_INLINE Dual operator/(const Dual& x, const V& s) {
    const V over = V(1.0) / s;
    return {x.a * over, over * x.v};
  }
  friend GROUND_INLINE Dual operator/(const V& s, const Dual& x) { return Dual(s) / x; }

#define GROUND_WITH_NUMBER(op)                                          \
  template <class S, class = std::enable_if_t<std::is_arithmetic_v<S>>> \
  friend GROUND_INLINE Dual operator op(const Dual& x, S s) {           \
    return x op V(static_cast<double>(s));                              \
  }                                                                     \
  template <class S, class = std::enable_if_t<std::is_arithmetic_v<S>>> \
  friend GROUND_INLINE Dual operator op(S s, const Dual& x) {           \
    return V(static_cast<double>(s)) op x;                              \
  }
  GROUND_WITH_NUMBER(+)
  GROUND_WITH_NUMBER(-)
  GROUND_WITH_NUMBER(*)
  GROUND_WITH_NUMBER(/)
#undef GROUND_WITH_NUMBER

 private:
  static bool isZero(double x) { return x == 0; }
  static bool isZero(const Lanes& x) { return allOf(x == Lanes(0.0)); }
};

template <typename V, int N>
GROUND_INLINE Dual<V, N> blend(const Mask& mask, const Dual<V, N>& x, const Dual<V, N>& y) {
  return {blend(mask, x.a, y.a),
          Directions<V, N>::each([&](int i) { return blend(mask, x.v[i], y.v[i]); })};
}

/// Chain rule: f(x) from the values of f and f' at x.a.
template <typename V, int N>
GROUND_INLINE Dual<V, N> chain(const Dual<V, N>& x, const V& value, const V& slope) {
  return {value, slope * x.v};
}

template <typename V, int N>
Dual<V, N> abs(const Dual<V, N>& x) {
  using std::abs;
  return chain(x, abs(x.a), V(blend(x.a < V(0.0), V(-1.0), V(1.0))));
}
template <typename V, int N>
GROUND_INLINE Dual<V, N> sqrt(const Dual<V, N>& x) {
  using std::sqrt;
  const V root = sqrt(x.a);
  return chain(x, root, V(V(0.5) / root));
}
template <typename V, int N>
Dual<V, N> exp(const Dual<V, N>& x) {
  using std::exp;
  const V value = exp(x.a);
  return chain(x, value, value);
}
template <typename V, int N>
Dual<V, N> sin(const Dual<V, N>& x) {
  using std::cos;
  using std::sin;
  return chain(x, V(sin(x.a)), V(cos(x.a)));
}
template <typename V, int N>
Dual<V, N> cos(const Dual<V, N>& x) {
  using std::cos;
  using std::sin;
  return chain(x, V(cos(x.a)), V(-sin(x.a)));
}
/// The base must be positive.
template <typename V, int N>
Dual<V, N> pow(const Dual<V, N>& base, const Dual<V, N>& exponent) {
  using std::log;
  using std::pow;
  const V value = pow(base.a, exponent.a);
  const V by_base = exponent.a * pow(base.a, exponent.a - V(1.0)),
          by_exponent = value * log(base.a);
  return {value, by_base * base.v + by_exponent * exponent.v};
}

}  // namespace ground

namespace Eigen {
template <typename V, int N>
struct NumTraits<ground::Dual<V, N>> : NumTraits<double> {
  using Real = ground::Dual<V, N>;
  using NonInteger = ground::Dual<V, N>;
  using Nested = ground::Dual<V, N>;
  enum { RequireInitialization = 1 };
};
}  // namespace Eigen
