#pragma once

#include <Eigen/Core>
#include <cmath>

#include "ground/model/registers.h"

namespace ground {

/// The result of a comparison in each of eight lanes.
struct Mask {
  Bits8 bits;  ///< all ones (true) or all zeros (false) in each lane

  GROUND_INLINE bool operator[](int i) const { return registers::at(bits, i) != 0; }
  GROUND_INLINE Mask operator&&(const Mask& other) const { return {bits & other.bits}; }
};

GROUND_INLINE bool allOf(bool condition) { return condition; }
GROUND_INLINE bool allOf(const Mask& m) { return registers::allOf(m.bits); }
GROUND_INLINE bool noneOf(bool condition) { return !condition; }
GROUND_INLINE bool noneOf(const Mask& m) { return registers::noneOf(m.bits); }

/// A scalar type of the model that holds one number of each of eight parallel simulations.
///
/// Arithmetic acts lane by lane: (a + b)[i] = a[i] + b[i]. A comparison gives a Mask, so code that
/// branches on a value uses blend() or choose() instead of if. Example:
///
///     const Lanes positive = choose(x > Lanes(0.0), [&] { return x; }, [] { return Lanes(0.0); });
///
/// The default constructor leaves the numbers uninitialised, like a double.
struct Lanes {
  static constexpr int kCount = 8;

  Vec8 x;

  Lanes() = default;
  GROUND_INLINE Lanes(double a) : x(registers::filled<Vec8>(a)) {}  // NOLINT: as numbers do
  GROUND_INLINE static Lanes of(const Vec8& x) {
    Lanes lanes;
    lanes.x = x;
    return lanes;
  }
  double& operator[](int i) { return reinterpret_cast<double*>(&x)[i]; }
  double operator[](int i) const { return registers::at(x, i); }

  GROUND_INLINE Lanes operator-() const { return of(-x); }
  GROUND_INLINE Lanes& operator+=(const Lanes& b) { return x += b.x, *this; }
  GROUND_INLINE Lanes& operator-=(const Lanes& b) { return x -= b.x, *this; }
  GROUND_INLINE Lanes& operator*=(const Lanes& b) { return x *= b.x, *this; }
  GROUND_INLINE Lanes& operator/=(const Lanes& b) { return x /= b.x, *this; }
  friend GROUND_INLINE Lanes operator+(const Lanes& a, const Lanes& b) { return of(a.x + b.x); }
  friend GROUND_INLINE Lanes operator-(const Lanes& a, const Lanes& b) { return of(a.x - b.x); }
  friend GROUND_INLINE Lanes operator*(const Lanes& a, const Lanes& b) { return of(a.x * b.x); }
  friend GROUND_INLINE Lanes operator/(const Lanes& a, const Lanes& b) { return of(a.x / b.x); }
  friend GROUND_INLINE Mask operator>(const Lanes& a, const Lanes& b) { return {a.x > b.x}; }
  friend GROUND_INLINE Mask operator<(const Lanes& a, const Lanes& b) { return {a.x < b.x}; }
  friend GROUND_INLINE Mask operator==(const Lanes& a, const Lanes& b) { return {a.x == b.x}; }
};

GROUND_INLINE Lanes blend(const Mask& mask, const Lanes& a, const Lanes& b) {
  return Lanes::of(registers::blend(mask.bits, a.x, b.x));
}

/// The value of `a` if the condition is true, else of `b`; a Mask selects lane by lane.
template <typename T>
GROUND_INLINE T blend(bool first, const T& a, const T& b) {
  return first ? a : b;
}

/// Like blend, with functions that give the values. A function that no lane needs is not called.
template <class Then, class Otherwise>
GROUND_INLINE auto choose(bool condition, const Then& then, const Otherwise& otherwise)
    -> decltype(then()) {
  return condition ? then() : otherwise();
}
template <class Then, class Otherwise>
GROUND_INLINE auto choose(const Mask& mask, const Then& then, const Otherwise& otherwise)
    -> decltype(then()) {
  if (allOf(mask)) return then();
  if (noneOf(mask)) return otherwise();
  return blend(mask, then(), otherwise());
}

GROUND_INLINE Lanes abs(const Lanes& a) { return blend(a < Lanes(0.0), -a, a); }
GROUND_INLINE Lanes sqrt(const Lanes& a) { return Lanes::of(registers::sqrt(a.x)); }

// Not inlined, so arguments and results are passed by reference.
namespace lanes {
void sin(const Lanes& a, Lanes& result);
void cos(const Lanes& a, Lanes& result);
void exp(const Lanes& a, Lanes& result);
void log(const Lanes& a, Lanes& result);
void pow(const Lanes& base, const Lanes& exponent, Lanes& result);
}  // namespace lanes

GROUND_INLINE Lanes sin(const Lanes& a) {
  Lanes result;
  lanes::sin(a, result);
  return result;
}
GROUND_INLINE Lanes cos(const Lanes& a) {
  Lanes result;
  lanes::cos(a, result);
  return result;
}
GROUND_INLINE Lanes exp(const Lanes& a) {
  Lanes result;
  lanes::exp(a, result);
  return result;
}
GROUND_INLINE Lanes log(const Lanes& a) {
  Lanes result;
  lanes::log(a, result);
  return result;
}
GROUND_INLINE Lanes pow(const Lanes& base, const Lanes& exponent) {
  Lanes result;
  lanes::pow(base, exponent, result);
  return result;
}

}  // namespace ground

namespace Eigen {
template <>
struct NumTraits<ground::Lanes> : NumTraits<double> {
  using Real = ground::Lanes;
  using NonInteger = ground::Lanes;
  using Nested = ground::Lanes;
  enum { RequireInitialization = 1 };
};
}  // namespace Eigen
