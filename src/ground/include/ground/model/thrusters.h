#pragma once

#include <algorithm>
#include <initializer_list>
#include <type_traits>

#include "ground/model/types.h"

namespace ground {

constexpr int kMaxThrusters = 8;

/// A number for each thruster of a craft, in the order of its model (ThrusterLayout): commands,
/// inputs after the actuators, or forces. It never allocates memory; a copy copies only the numbers
/// in use.
template <typename T>
class Thrusters {
 public:
  Thrusters() = default;  ///< no thrusters
  Thrusters(std::initializer_list<T> values) : count_(static_cast<int>(values.size())) {
    int i = 0;
    for (const T& value : values) values_[i++] = value;
  }
  /// Converts an Eigen vector, such as that of a left and a right thruster.
  template <class Derived>
  Thrusters(const Eigen::MatrixBase<Derived>& values)  // NOLINT: as vectors do
      : count_(static_cast<int>(values.size())) {
    for (int i = 0; i < count_; ++i) values_[i] = values(i);
  }
  Thrusters(const Thrusters& other) : count_(other.count_) { take(other); }
  Thrusters& operator=(const Thrusters& other) {
    count_ = other.count_;
    take(other);
    return *this;
  }
  static Thrusters zero(int count) { return filled(count, T(0.0)); }
  static Thrusters filled(int count, const T& value) {
    Thrusters all;
    all.count_ = count;
    for (int i = 0; i < count; ++i) all.values_[i] = value;
    return all;
  }

  int size() const { return count_; }
  T& operator()(int i) { return values_[i]; }
  const T& operator()(int i) const { return values_[i]; }
  T* begin() { return values_; }
  T* end() { return values_ + count_; }
  const T* begin() const { return values_; }
  const T* end() const { return values_ + count_; }

  Thrusters& operator*=(const T& factor) {
    for (T& value : *this) value *= factor;
    return *this;
  }
  template <typename U>
  Thrusters<U> cast() const {
    Thrusters<U> result;
    result.set(*this, [](const T& value) { return U(value); });
    return result;
  }
  /// Sets the numbers to the results of function `of` for each number of `from`.
  template <typename U, class Of>
  GROUND_INLINE void set(const Thrusters<U>& from, const Of& of) {
    count_ = from.count_;
    forEach([&](int i) { values_[i] = of(from.values_[i]); });
  }
  /// Calls `act(i)` for each thruster i. Two thrusters, the most frequent case, are faster without a
  /// loop, and other numbers need none that is unrolled.
  template <class Do>
  GROUND_INLINE void forEach(const Do& act) const {
    if (count_ == 2) {
      act(0);
      act(1);
    } else {
#pragma GCC unroll 1
      for (int i = 0; i < count_; ++i) act(i);
    }
  }

 private:
  template <typename U>
  friend class Thrusters;

  /// Copies a pair of doubles as one block, because doubles that were stored one by one are loaded
  /// late as a vector; and each Dual by its members, for the same reason.
  GROUND_INLINE void take(const Thrusters& other) {
    if (count_ != 2) {
      takeMany(other);
    } else if constexpr (std::is_same_v<T, double>) {
      std::copy_n(other.values_, 2, values_);
    } else {
      values_[0] = other.values_[0];
      values_[1] = other.values_[1];
    }
  }
  __attribute__((noinline)) void takeMany(const Thrusters& other) {
    std::copy_n(other.values_, count_, values_);
  }

  int count_ = 0;
  T values_[kMaxThrusters];  ///< the first count_ are set
};

}  // namespace ground
