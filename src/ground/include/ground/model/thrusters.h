#pragma once

#include <initializer_list>
#include <stdexcept>
#include <string>

#include "ground/model/types.h"

namespace ground {

constexpr int kMaxThrusters = 8;

/// A number for each thruster of a craft, in the order of its model (ThrusterLayout): commands,
/// inputs after the actuators, or forces. It never allocates memory; a copy copies only the numbers
/// in use. More than kMaxThrusters are refused by std::invalid_argument.
template <typename T>
class Thrusters {
 public:
  Thrusters() {}  ///< no thrusters
  Thrusters(std::initializer_list<T> values) : count_(checked(values.size())) {
    int i = 0;
    for (const T& value : values) values_[i++] = value;
  }
  /// Converts an Eigen vector, such as the inputs of a left and a right thruster.
  template <class Derived>
  Thrusters(const Eigen::MatrixBase<Derived>& values)  // NOLINT: as vectors do
      : count_(checked(static_cast<std::size_t>(values.size()))) {
    for (int i = 0; i < count_; ++i) values_[i] = values(i);
  }
  Thrusters(const Thrusters& other) { *this = other; }
  Thrusters& operator=(const Thrusters& other) {
    count_ = other.count_;
    for (int i = 0; i < count_; ++i) values_[i] = other.values_[i];
    return *this;
  }
  static Thrusters zero(int count) { return filled(count, T(0.0)); }
  static Thrusters filled(int count, const T& value) {
    Thrusters all;
    all.count_ = checked(static_cast<std::size_t>(count));
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
    result.count_ = count_;
    for (int i = 0; i < count_; ++i) result.values_[i] = U(values_[i]);
    return result;
  }

 private:
  template <typename U>
  friend class Thrusters;

  static int checked(std::size_t count) {
    if (count <= std::size_t{kMaxThrusters}) return static_cast<int>(count);
    throw std::invalid_argument("a craft has at most 8 thrusters, not " + std::to_string(count));
  }

  int count_ = 0;
  union {                      // so that numbers that are not in use are not initialised
    T values_[kMaxThrusters];  ///< the first count_ are set
  };
};

}  // namespace ground
