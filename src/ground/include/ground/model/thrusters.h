#pragma once

#include <initializer_list>

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
    return each<U>([](const T& value) { return U(value); });
  }
  /// The results of function `of` for each number.
  template <typename U, class Of>
  Thrusters<U> each(const Of& of) const {
    Thrusters<U> result;
    result.count_ = count_;
    forEach([&](int i) { result.values_[i] = of(values_[i]); });
    return result;
  }

 private:
  template <typename U>
  friend class Thrusters;

  void take(const Thrusters& other) {
    forEach([&](int i) { values_[i] = other.values_[i]; });
  }
  /// Two thrusters, the most frequent case, are faster without a loop.
  template <class Do>
  GROUND_INLINE void forEach(const Do& act) const {
    if (count_ == 2) {
      act(0);
      act(1);
      return;
    }
    for (int i = 0; i < count_; ++i) act(i);
  }

  int count_ = 0;
  T values_[kMaxThrusters];  ///< the first count_ are set
};

}  // namespace ground
