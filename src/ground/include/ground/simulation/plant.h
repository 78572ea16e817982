#pragma once

#include "ground/model/dynamics.h"

namespace ground {

/// A simulated craft on the floor of a SimulatedLab: it receives commands and moves. Its motion may follow
/// any equations, not only a Model's.
class Plant {
 public:
  virtual ~Plant() = default;

  /// The craft receives a command at the current time. Inputs are finite, one for each thruster, in
  /// the model's units, and may be outside the thrusters' ranges; zeros turn the motors off. Throws
  /// std::invalid_argument on another number of thrusters.
  virtual void command(const Thrusters<double>& thrusters, double lift) = 0;
  /// Moves the craft to `time` [s] of the room's clock, which is not before the current time.
  virtual void advance(double time) = 0;

  /// True state at the current time.
  virtual RigidState<double> state() const = 0;
  /// Derivative of the state at the current time.
  virtual RigidState<double> derivative() const = 0;
  /// Exact measurement of the state: pose and velocity of the rigid body that the mocap sees.
  virtual Measurement<double> measurement() const = 0;
  /// Disturbance at the current time: X, Y [N], N [N m], body.
  virtual Vector3<double> wrench() const = 0;
  /// Voltage of its battery at the current time [V]; 0: it has none.
  virtual double voltage() const { return 0; }
  /// Noise of the pose in the frame that is captured now [m], [m], [rad], besides the noise of
  /// MocapParams. Called once for every frame, delivered or lost.
  virtual Vector3<double> poseNoise() { return Vector3<double>::Zero(); }
};

}  // namespace ground
