#pragma once

#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <utility>

#include "ground/control/fence.h"
#include "ground/model/dynamics.h"

namespace ground {

/// Parameters that all controllers share.
struct LifecycleParams {
  double lift = 1.0;           ///< input of the lift fan while the craft is driven, 0..1
  double lift_time = 1.0;      ///< lift alone before the thrusters start [s]
  double state_timeout = 0.2;  ///< oldest state with which to drive [s]
  double recovery_time = 0.0;  ///< zero thrust bridges such a loss of the state [s]
  double rate = 50.0;          ///< of closed-loop control [Hz]
  bool require_armed = true;   ///< whether it waits for an armed sender, and stops with it
  /// Whether it waits for a valid state, and stops without one. Otherwise states are ignored, and the
  /// fence with them: on a bench, where the craft is fastened.
  bool require_state = true;

  std::string validate() const;  ///< what is wrong; empty when nothing is
};

/// Inputs of the two thrusters and of the lift fan, 0..1.
struct Inputs {
  double left = 0, right = 0, lift = 0;
};

/// One instant on two clocks: the steady one, by which watchdogs run, and the one of stamps, which
/// somebody may set. A simulation has one clock for both.
struct Instant {
  double steady, time;  ///< [s]
};

/// What the mocap says of the craft.
struct MeasuredState {
  double stamp = 0;  ///< when it was measured, on the clock of stamps [s]
  RigidState<double> state;
  bool valid = false;
  std::string problem = {};  ///< why it is not valid
  Vector3<double> nu_variance = Vector3<double>::Zero();  ///< of the velocities
};

/// Says what to command while a controller drives. Times `elapsed` are seconds since it began.
class Pilot {
 public:
  static constexpr double kByState = -1.0;  ///< nextChange() while it is driven by the state

  virtual ~Pilot() = default;
  /// Every command that went out, whoever gave it, in order of time (clock of stamps) [s].
  virtual void commanded(double /*time*/, const Inputs& /*inputs*/) {}
  /// Driving begins at the time of `stamp`; what it throws refuses the start.
  virtual void activate(double /*stamp*/) {}
  /// Driving ends, for whatever reason.
  virtual void deactivate() {}
  /// Why it has to stop, empty when it may go on; asked with every state and before every update
  /// that goes by the state.
  virtual std::string objection(const MeasuredState& /*measured*/) { return ""; }
  /// The inputs from now on; `lift`: that of the life cycle's parameters, 0..1.
  virtual Inputs update(double elapsed, double stamp, const RigidState<double>& state,
                        double lift) = 0;
  /// When it is done.
  virtual double end() const { return std::numeric_limits<double>::infinity(); }
  /// When an open-loop controller changes its inputs next; a closed-loop one is driven by the state
  /// instead, at most at `rate`. Asked before it is activated where no state is required, and anew
  /// after every state and update.
  virtual double nextChange(double /*elapsed*/) const { return kByState; }
  /// What whoever starts it should know; empty when nothing.
  const std::string& caution() const { return caution_; }
  void setCaution(std::string caution) { caution_ = std::move(caution); }

 private:
  std::string caution_;
};

/// The life of a controller: whether it may drive, and what goes out while it may not. The same
/// object runs in the nodelets and in simulated experiments. Free of clocks; the caller serialises
/// the calls.
///
/// IDLE, WAITING (for a valid state and an armed sender), LIFTING, RUNNING, then DONE or STOPPED;
/// RECOVERING while the state is lost in between (LIFTING goes on meanwhile). Thrust goes out in RUNNING only, lift in LIFTING,
/// RUNNING and RECOVERING. It stops when the state is stale or invalid for recovery_time, at once
/// where that is 0 or the state is not finite, when the state jumps as no craft can, when the craft
/// would leave the room, when the sender disarms, when the clock was set, when another controller
/// takes over, when the pilot objects and when a command is not finite. Where no state is required
/// (LifecycleParams), only a pilot that does not go by it may drive.
class ControllerLifecycle {
 public:
  /// Numbers as in ground_msgs/ControllerStatus.
  enum class State { kIdle, kWaiting, kLifting, kRunning, kDone, kStopped, kRecovering };
  /// A command goes out.
  using Send = std::function<void(const Inputs&)>;
  /// State or reason have changed.
  using Changed = std::function<void()>;
  static constexpr double kKeepalive = 0.02;  ///< between repeated commands [s]

  /// The pilot has to outlive it.
  ControllerLifecycle(Pilot& pilot, Send send, Changed changed);

  /// Takes effect at once.
  void setParams(const LifecycleParams& params) { params_ = params; }
  const LifecycleParams& params() const { return params_; }
  /// Keeps the craft inside; nothing for no bounds. Takes effect with the next state.
  void setFence(std::optional<Fence> fence) { fence_ = std::move(fence); }

  /// Says why it cannot be started; empty when it is.
  std::string start(Instant now);
  void stop(Instant now, const std::string& reason);
  /// The sender says whether it is armed, and why not.
  void sender(Instant now, bool armed, const std::string& reason);
  /// Another controller, named so, gives a command. While it does, this one is silent. The one that
  /// was started last drives: this one stops, or takes the other's place with the lift on.
  void otherDrives(Instant now, const std::string& name, double lift);
  /// A state came in.
  void state(Instant now, const MeasuredState& measured);
  /// Zero inputs go out now, unless another controller drives.
  void sendZero(Instant now) { send(now, {}); }
  /// The clock of stamps was set.
  void timeJumped(Instant now, const std::string& what);
  /// Moves on to now.
  void tick(Instant now);
  /// By when on each clock tick() has to be called, as far as is known.
  Instant due() const;

  State current() const { return state_; }
  const std::string& reason() const { return reason_; }
  /// From its start to its end.
  bool started() const {
    return state_ == State::kWaiting || state_ == State::kLifting || driving();
  }
  /// The pilot is at work, be it that the state is lost for a moment.
  bool driving() const { return state_ == State::kRunning || state_ == State::kRecovering; }
  /// Seconds since it began to drive.
  double elapsed(double time) const { return driving() ? time - running_since_ : 0; }

 private:
  static constexpr double kNever = std::numeric_limits<double>::infinity();

  /// Lift is on: it lifts or drives.
  bool flying() const { return state_ == State::kLifting || driving(); }
  std::string stateProblem(Instant now) const;
  bool stateIsFinite() const;
  std::string jumped(const MeasuredState& state) const;
  bool bridge(Instant now, const std::string& problem);
  std::string fenceProblem(Instant now) const;
  void act(Instant now);
  void schedule(double elapsed);
  void begin(Instant now);
  void control(Instant now, double stamp);
  void enter(Instant now, State state, const std::string& reason);
  void change(State state, const std::string& reason);
  void send(Instant now, const Inputs& inputs);
  double liftAlone() const;
  double liftedAt() const;
  double repeatAt() const;

  Pilot& pilot_;
  Send send_;
  Changed changed_;
  LifecycleParams params_;
  State state_ = State::kIdle;
  std::string reason_ = "not started yet";
  std::optional<Fence> fence_;
  bool armed_ = false;
  std::optional<MeasuredState> measured_;
  double measured_at_ = 0;              ///< steady clock [s]
  std::optional<MeasuredState> known_;  ///< the last one with which it was driven
  double lifting_since_ = 0, running_since_ = 0;  ///< clock of stamps [s]
  std::optional<double> last_update_;             ///< stamp [s]
  /// When open-loop inputs change, clock of stamps [s]; none while the pilot goes by the state.
  std::optional<double> change_at_;
  double started_at_ = 0;                         ///< steady clock [s]
  double others_until_ = -kNever;  ///< how long another controller may be taken to drive [s]
  bool lifted_ = false;            ///< by another controller, whose place is taken
  /// Since when there has been no state to lift or drive by, steady clock [s].
  std::optional<double> lost_since_;
  double next_keepalive_ = -kNever;  ///< steady clock [s]
};

/// As in messages and logs: "RUNNING".
const char* nameOf(ControllerLifecycle::State state);

}  // namespace ground
