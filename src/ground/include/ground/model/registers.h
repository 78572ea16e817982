#pragma once

#include <cmath>
#include <cstring>
#include <type_traits>

#define GROUND_INLINE inline __attribute__((always_inline))

/// Vec8, eight numbers in as many registers as the processor needs for them: one with AVX-512, two
/// with AVX, four otherwise.
///
/// gcc's own vectors of 64 bytes stay in memory where no register holds all of them, which makes the
/// model four times as slow; the members of a Pair get registers of their own. The layout in memory is
/// the same everywhere. How a Vec8 is passed by value depends on the processor, so functions that are
/// not inlined take it by reference.
namespace ground {
namespace registers {

#if defined(__AVX512F__)
constexpr int kBytes = 64;
#elif defined(__AVX__)
constexpr int kBytes = 32;
#else
constexpr int kBytes = 16;
#endif
using Register = double __attribute__((vector_size(kBytes)));
using Bits = decltype(Register{} < Register{});

template <class Half>
struct alignas(2 * sizeof(Half)) Pair {
  Half low, high;

  Pair() = default;
  GROUND_INLINE Pair(const Half& first, const Half& second) : low(first), high(second) {}
  // Copied by its members: gcc copies blocks otherwise, in pieces that are smaller than a register, and
  // the register's next load has to wait for all of them.
  GROUND_INLINE Pair(const Pair& other) noexcept : low(other.low), high(other.high) {}
  GROUND_INLINE Pair& operator=(const Pair& other) noexcept {
    low = other.low;
    high = other.high;
    return *this;
  }

  GROUND_INLINE Pair operator-() const { return {-low, -high}; }
#define GROUND_FOR_HALVES(op)                                                                      \
  friend GROUND_INLINE Pair operator op(const Pair& a, const Pair& b) {                            \
    return {a.low op b.low, a.high op b.high};                                                     \
  }
  GROUND_FOR_HALVES(+)
  GROUND_FOR_HALVES(-)
  GROUND_FOR_HALVES(*)
  GROUND_FOR_HALVES(/)
  GROUND_FOR_HALVES(&)
  GROUND_FOR_HALVES(|)
#undef GROUND_FOR_HALVES
  friend GROUND_INLINE Pair operator*(double a, const Pair& b) { return {a * b.low, a * b.high}; }
  friend GROUND_INLINE Pair operator*(const Pair& a, double b) { return {a.low * b, a.high * b}; }
  friend GROUND_INLINE auto operator<(const Pair& a, const Pair& b) {
    return Pair<decltype(a.low < b.low)>{a.low < b.low, a.high < b.high};
  }
  friend GROUND_INLINE auto operator>(const Pair& a, const Pair& b) { return b < a; }
  friend GROUND_INLINE auto operator==(const Pair& a, const Pair& b) {
    return Pair<decltype(a.low == b.low)>{a.low == b.low, a.high == b.high};
  }
  GROUND_INLINE Pair& operator+=(const Pair& b) { return *this = *this + b; }
  GROUND_INLINE Pair& operator-=(const Pair& b) { return *this = *this - b; }
  GROUND_INLINE Pair& operator*=(const Pair& b) { return *this = *this * b; }
  GROUND_INLINE Pair& operator*=(double b) { return *this = *this * b; }
  GROUND_INLINE Pair& operator/=(const Pair& b) { return *this = *this / b; }
};

template <class V>
struct IsPair : std::false_type {};
template <class Half>
struct IsPair<Pair<Half>> : std::true_type {};

/// All numbers are a.
template <class V>
GROUND_INLINE V filled(double a) {
  if constexpr (IsPair<V>::value) {
    const auto half = filled<decltype(V::low)>(a);
    return {half, half};
  } else {
    return a - V{};  // a - 0 is a, for -0 too
  }
}

/// The i-th number, or the i-th result of a comparison.
template <class V>
GROUND_INLINE auto at(const V& x, int i) {
  if constexpr (IsPair<V>::value) {
    constexpr int kHalf = sizeof(V) / 2 / sizeof(double);
    return i < kHalf ? at(x.low, i) : at(x.high, i - kHalf);
  } else {
    return x[i];
  }
}

/// a where the comparison is true, else b.
template <class B, class V>
GROUND_INLINE V blend(const B& mask, const V& a, const V& b) {
  if constexpr (IsPair<V>::value)
    return {blend(mask.low, a.low, b.low), blend(mask.high, a.high, b.high)};
  else
    return mask ? a : b;
}

template <class B>
GROUND_INLINE bool allOf(const B& mask) {
  if constexpr (IsPair<B>::value) {
    return allOf(mask.low & mask.high);
  } else {
    long long all = -1;
    for (std::size_t i = 0; i < sizeof mask / sizeof all; ++i) all &= mask[i];
    return all != 0;
  }
}

template <class B>
GROUND_INLINE bool noneOf(const B& mask) {
  if constexpr (IsPair<B>::value) {
    return noneOf(mask.low | mask.high);
  } else {
    long long any = 0;
    for (std::size_t i = 0; i < sizeof mask / sizeof any; ++i) any |= mask[i];
    return any == 0;
  }
}

template <class V>
GROUND_INLINE V sqrt(const V& x) {
  if constexpr (IsPair<V>::value) {
    return {sqrt(x.low), sqrt(x.high)};
  } else {
    V root;
    for (std::size_t i = 0; i < sizeof x / sizeof x[0]; ++i) root[i] = std::sqrt(x[i]);
    return root;
  }
}

/// Reads numbers that need not be aligned.
template <class V>
GROUND_INLINE V load(const double* from) {
  if constexpr (IsPair<V>::value) {
    using Half = decltype(V::low);
    return {load<Half>(from), load<Half>(from + sizeof(Half) / sizeof *from)};
  } else {
    V x;
    std::memcpy(&x, from, sizeof x);
    return x;
  }
}

/// Writes numbers, which need not be aligned.
template <class V>
GROUND_INLINE void store(const V& x, double* to) {
  if constexpr (IsPair<V>::value) {
    store(x.low, to);
    store(x.high, to + sizeof x.low / sizeof *to);
  } else {
    std::memcpy(to, &x, sizeof x);
  }
}

template <int bytes>
struct Eight {
  using Numbers = Pair<typename Eight<2 * bytes>::Numbers>;
  using Results = Pair<typename Eight<2 * bytes>::Results>;
};
template <>
struct Eight<64> {
  using Numbers = Register;
  using Results = Bits;
};

}  // namespace registers

using Vec8 = registers::Eight<registers::kBytes>::Numbers;
using Bits8 = registers::Eight<registers::kBytes>::Results;

}  // namespace ground
