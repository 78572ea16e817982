#pragma once

#include <array>
#include <random>

#include "ground/estimation/inertial_fusion.h"
#include "ground/model/types.h"

namespace ground {

/// A sample of a flight controller's sensors, in their units: z points down.
struct ImuSample {
  int yaw_rate;                     ///< [deg/s / 16.4]
  std::array<int, 2> acceleration;  ///< ahead and to starboard [g / 2048]
};

/// A usual gyro and accelerometer of a flight controller, mounted as such are: off the centre, turned by a
/// few degrees, with biases that are drawn once.
class SimulatedImu {
 public:
  static constexpr int kGravity = 2048;

  explicit SimulatedImu(unsigned seed);

  /// A sample at a state of the craft with this acceleration, the derivative of nu.
  ImuSample sample(const RigidState<double>& state, const Vector3<double>& nu_dot);
  /// How it is mounted and scaled; without its biases.
  InertialMounting mounting() const;

 private:
  double normal(double deviation) { return deviation * normal_(random_); }

  std::mt19937 random_;
  std::normal_distribution<double> normal_;
  double turn_bias_;
  Vector2<double> bias_, place_;
  double angle_;  ///< of the mounting [rad]
};

}  // namespace ground
