#pragma once

#include <deque>
#include <random>
#include <string>
#include <vector>

#include "ground/parameters/MocapFields.h"
#include "ground/simulation/model_craft.h"
#include "ground/simulation/plant.h"

namespace ground {

/// Quality and rate of the simulated motion capture.
struct MocapParams : MocapFields {
  double rate = 100.0;    ///< frames per second [Hz]
  bool gaps_vary = true;  ///< durations of gaps are exponentially distributed; otherwise constant

  std::string validate() const;  ///< error message; empty if all values are valid
};

/// One frame of the mocap.
struct MocapFrame {
  double captured = 0.0;   ///< [s]
  double delivered = 0.0;  ///< [s]
  Vector3<double> eta;     ///< x, y [m], psi [rad], world_ned, with noise
};

/// Simulates a craft on the floor of a room with motion capture: the craft under the received
/// commands, and the frames that the mocap delivers. Uses neither ROS nor a clock: the caller gives
/// the time, and the same seed and commands give the same frames.
class SimulatedLab {
 public:
  /// The mocap has the same seed.
  struct Params : ModelCraft::Params {
    /// The craft stops its motors after this time without command [s]; 0: never.
    double watchdog = 0.25;
  };

  /// The craft must outlive the room, which uses the start, seed and watchdog of `params`. Throws
  /// std::invalid_argument if mocap parameters are bad.
  SimulatedLab(Plant& plant, const MocapParams& mocap, const Params& params);

  /// The craft receives a command at the current time. Values are clipped to the range of the
  /// thrusters; inputs of thrusters are in the model's units.
  void command(const Thrusters<double>& thrusters, double lift);
  /// For a craft with a left and a right thruster.
  void command(double left, double right, double lift) { command({left, right}, lift); }
  /// Simulates to `time` [s]; collects the frames delivered until then.
  void advance(double time);
  /// Frames delivered since the last call, in the order of delivery.
  std::vector<MocapFrame> takeFrames();
  /// Takes effect with the next frame; throws std::invalid_argument if parameters are bad.
  void setMocap(const MocapParams& mocap);
  /// Takes effect at once; throws std::invalid_argument if it is not finite or negative.
  void setWatchdog(double watchdog);

  double time() const { return time_; }
  /// Time of the next capture, lost or not [s].
  double nextCapture() const { return next_frame_; }
  /// The earliest time at which takeFrames() may return a new frame [s].
  double nextDelivery() const {
    return on_their_way_.empty() ? next_frame_ + mocap_.latency : on_their_way_.front().delivered;
  }
  /// The craft's motion, see Plant.
  RigidState<double> state() const { return plant_.state(); }
  RigidState<double> derivative() const { return plant_.derivative(); }
  Measurement<double> measurement() const { return plant_.measurement(); }
  Vector3<double> wrench() const { return plant_.wrench(); }
  double voltage() const { return plant_.voltage(); }
  /// Whether the craft's own watchdog has stopped the motors.
  bool watchdogExpired() const { return expired_; }

 private:
  void capture();
  bool lost(double time);

  Plant& plant_;
  double watchdog_;  ///< Params::watchdog [s]
  MocapParams mocap_;
  std::mt19937_64 random_;
  std::normal_distribution<double> normal_;
  double time_;
  double last_command_;
  Thrusters<double> off_;  ///< zeros, one for each thruster; set by the first command
  bool expired_ = true;    ///< motors are off until the first command
  double next_frame_;
  double tracked_again_;
  std::deque<MocapFrame> on_their_way_;
};

}  // namespace ground
