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
  double latency = 4e-3;         ///< from capture to delivery [s]
  double loss = 0.0;             ///< share of single frames lost, 0..1
  double gap_rate = 0.0;         ///< losses of tracking per second [1/s]
  double gap_length = 0.2;       ///< mean duration of a loss of tracking [s]
  bool gaps_vary = true;         ///< exponentially distributed; otherwise all of one length

  /// Says what is wrong; empty when nothing is.
  std::string validate() const;
};

/// What the mocap says of one instant.
struct MocapFrame {
  double captured = 0.0;   ///< [s]
  double delivered = 0.0;  ///< [s]
  Vector3<double> eta;     ///< x, y [m], psi [rad], world_ned, with noise
};

/// A craft on the floor of a room with motion capture: the model driven by the commands that reach
/// it, and the frames that the mocap delivers. Free of ROS and of clocks: time is what the caller
/// says, and the same seed and commands give the same frames.
class Room {
 public:
  struct Params {
    RigidState<double> initial;  ///< of the craft
    double start = 0.0;          ///< time at which the room comes to be [s]
    /// The craft stops its motors after this long without command [s]; 0: never.
    double watchdog = 0.25;
    unsigned long seed = 1;
    Disturbance disturbance = {};  ///< acts on the craft; that of the model does not
    /// Without lift the craft sits on the floor, whose dry friction brakes it by so much [m/s^2].
    double braking = 2.0;
  };

  /// Throws std::invalid_argument when mocap parameters or the disturbance are bad.
  Room(const Model& model, const MocapParams& mocap, const Params& params);
  Room(const Room&) = delete;
  Room& operator=(const Room&) = delete;

  /// A command reaches the craft at the current time. Values are clipped to what the thrusters can
  /// do; left and right are in the model's units of input.
  void command(double left, double right, double lift);
  /// Runs to `time` [s]; collects the frames delivered until then.
  void advance(double time);
  /// Frames delivered since the last call, in the order of delivery.
  std::vector<MocapFrame> takeFrames();
  /// From now on another model moves the craft, from where it is and as fast as it is. Throws
  /// std::invalid_argument, and leaves the old one, when the craft cannot move by it.
  void setModel(const Model& model);
  /// Takes effect with the next frame; throws std::invalid_argument when bad.
  void setMocap(const MocapParams& mocap);
  /// Takes effect at once; throws std::invalid_argument when it is not finite or negative.
  void setWatchdog(double watchdog);

  double time() const { return time_; }
  /// When the mocap exposes its next frame, lost or not [s].
  double nextCapture() const { return next_frame_; }
  /// The earliest instant at which takeFrames() may have something new [s].
  double nextDelivery() const {
    return on_their_way_.empty() ? next_frame_ + mocap_.latency : on_their_way_.front().delivered;
  }
  const RigidState<double>& state() const { return moving_->simulation.state(); }
  /// What an exact mocap makes of the state.
  Measurement<double> measurement() const { return moving_->simulation.measure(); }
  RigidState<double> derivative() const;
  /// The disturbance that acts now: X, Y [N], N [N m], body.
  const Vector3<double>& wrench() const { return wrench_; }
  /// Whether the craft's own watchdog has stopped the motors.
  bool watchdogExpired() const { return expired_; }

 private:
  /// A model at work.
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
  double next_wrench_;        ///< when it changes [s]
  unsigned long drawn_ = 0;   ///< how often it has
  Model model_;
  InputSequence inputs_;
  std::unique_ptr<Moving> moving_;
  MocapParams mocap_;
  std::mt19937_64 random_;
  std::normal_distribution<double> normal_;
  double time_;
  double last_command_;
  /// Input of the lift fan; none before the first lift: a craft that starts in motion hovers.
  std::optional<double> lift_;
  bool expired_ = true;  ///< motors are off until the first command
  double next_frame_;
  double tracked_again_;
  std::deque<MocapFrame> on_their_way_;
};

}  // namespace ground
