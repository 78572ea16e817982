#pragma once

#include <algorithm>
#include <cmath>

#include "ground/model/thrusters.h"

namespace ground {

/// The numbers of all thrusters as a vector that refers to them.
inline Eigen::Map<Eigen::VectorXd> asVector(Thrusters<double>& numbers) {
  return {numbers.begin(), numbers.size()};
}
inline Eigen::Map<const Eigen::VectorXd> asVector(const Thrusters<double>& numbers) {
  return {numbers.begin(), numbers.size()};
}

inline bool operator==(const Thrusters<double>& a, const Thrusters<double>& b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end());
}
inline bool operator!=(const Thrusters<double>& a, const Thrusters<double>& b) { return !(a == b); }

/// Inputs of the thrusters, in the order of the model, as fractions of the largest input, and of
/// the lift fan, 0..1.
struct Inputs {
  Thrusters<double> thrusters{0.0, 0.0};
  double lift = 0;

  Inputs() = default;  ///< a left and a right thruster and the lift, all off
  Inputs(const Thrusters<double>& all, double lift_input) : thrusters(all), lift(lift_input) {}
  Inputs(double left, double right, double lift_input) : thrusters{left, right}, lift(lift_input) {}
  /// `count` thrusters that are off.
  static Inputs off(int count, double lift_input = 0) { return {Thrusters<double>::zero(count), lift_input}; }

  bool finite() const { return asVector(thrusters).allFinite() && std::isfinite(lift); }
  /// Largest size of the input of a thruster.
  double thrust() const { return asVector(thrusters).lpNorm<Eigen::Infinity>(); }
  bool zero() const { return thrust() == 0 && lift == 0; }
  bool operator==(const Inputs& other) const { return thrusters == other.thrusters && lift == other.lift; }
  bool operator!=(const Inputs& other) const { return !(*this == other); }
};

}  // namespace ground
