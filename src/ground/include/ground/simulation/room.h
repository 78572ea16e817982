#pragma once

#include <Eigen/LU>
#include <deque>
#include <memory>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include "ground/model/simulation.h"
#include "ground/simulation/disturbance_source.h"

namespace ground {

/// Quality of the simulated motion capture.
struct MocapParams {
  double rate = 100.0;           ///< frames per second [Hz]
  double position_noise = 3e-4;  ///< standard deviation of x and y [m]
  double heading_noise = 5e-3;   ///< standard deviation of psi [rad]
  double latency = 4e-3;         ///< time from capture to delivery [s]
  double loss = 0.0;             ///< probability of a single lost frame, 0..1
  double gap_rate = 0.0;         ///< rate of losses of tracking [1/s]
  double gap_length = 0.2;       ///< mean duration of a loss of tracking [s]
  bool gaps_vary = true;         ///< durations are exponentially distributed; otherwise constant

  /// Error message, or an empty string if all values are valid.
  std::string validate() const;
};

/// One frame of the mocap.
struct MocapFrame {
  double captured = 0.0;   ///< [s]
  double delivered = 0.0;  ///< [s]
  Vector3<double> eta;     ///< x, y [m], psi [rad], world_ned, with noise
};

/// Simulates a craft on the floor of a room with motion capture: the model under the received
/// commands, and the frames that the mocap delivers. Uses neither ROS nor a clock: the caller gives
/// the time, and the same seed and commands give the same frames.
class Room {
 public:
  struct Params {
    RigidState<double> initial;  ///< initial state of the craft
    double start = 0.0;          ///< initial time [s]
    /// The craft stops its motors after this time without command [s]; 0: never.
    double watchdog = 0.25;
    unsigned long seed = 1;
    Disturbance disturbance = {};  ///< disturbance of the craft; Model::disturbance is not used
    /// Deceleration by dry friction of the floor while the lift is off [m/s^2].
    double braking = 2.0;
  };

  /// Throws std::invalid_argument if mocap parameters or the disturbance are bad.
  Room(const Model& model, const MocapParams& mocap, const Params& params);
  Room(const Room&) = delete;
  Room& operator=(const Room&) = delete;

  /// The craft receives a command at the current time. Values are clipped to the range of the
  /// thrusters; left and right are in the model's units.
  void command(double left, double right, double lift);
  /// Simulates to `time` [s]; collects the frames delivered until then.
  void advance(double time);
  /// Frames delivered since the last call, in the order of delivery.
  std::vector<MocapFrame> takeFrames();
  /// Replaces the model; pose and velocity stay. Throws std::invalid_argument, and keeps the old
  /// model, if the acceleration by the new one is not finite.
  void setModel(const Model& model);
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
  const RigidState<double>& state() const { return moving_->simulation.state(); }
  /// Exact measurement of the state.
  Measurement<double> measurement() const { return moving_->simulation.measure(); }
  RigidState<double> derivative() const;
  /// The current disturbance: X, Y [N], N [N m], body.
  const Vector3<double>& wrench() const { return wrench_; }
  /// Whether the craft's own watchdog has stopped the motors.
  bool watchdogExpired() const { return expired_; }

 private:
  /// The simulation of a model.
  struct Moving {
    Moving(const Model& model, const InputSequence& inputs, const RigidState<double>& state,
           double time)
        : dynamics(model),
          simulation(dynamics, inputs, state, time),
          mobility(dynamics.mass().inverse()) {}
    Dynamics<double> dynamics;
    Simulation<double> simulation;
    Matrix3<double> mobility;  ///< inverse of the mass matrix
  };

  Model onThisRun(Model model) const;
  void move(double time);
  bool sits() const { return lift_ && *lift_ == 0; }
  Vector3<double> friction() const;
  void capture();
  void forgetCommands();
  bool lost(double time);

  Params params_;
  std::optional<DisturbanceSource> source_;
  Vector3<double> wrench_ = Vector3<double>::Zero();
  double next_wrench_;        ///< time of the next change of wrench_ [s]
  unsigned long drawn_ = 0;   ///< number of changes of wrench_
  Model model_;
  InputSequence inputs_;
  std::unique_ptr<Moving> moving_;
  MocapParams mocap_;
  std::mt19937_64 random_;
  std::normal_distribution<double> normal_;
  double time_;
  double last_command_;
  /// Input of the lift fan; no value before the first lift, so that a craft can start in motion.
  std::optional<double> lift_;
  bool expired_ = true;  ///< motors are off until the first command
  double next_frame_;
  double tracked_again_;
  std::deque<MocapFrame> on_their_way_;
};

}  // namespace ground
