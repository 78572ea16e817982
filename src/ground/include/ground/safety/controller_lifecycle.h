#pragma once

#include <exception>
#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <utility>

#include "ground/model/dynamics.h"
#include "ground/model/inputs.h"
#include "ground/parameters/LifecycleFields.h"
#include "ground/safety/fence_guard.h"
#include "ground/safety/freshness.h"

namespace ground {

/// Parameters that all controllers share, and what they need in order to drive.
struct LifecycleParams : LifecycleFields {
  bool require_armed = true;  ///< whether it waits for an armed sender, and stops with it
  /// Whether it waits for a valid state, and stops without one. Otherwise it ignores states and the
  /// fence: for a bench where the craft is fastened.
  bool require_state = true;
};

/// Computes the commands while a controller drives. Times `elapsed` are seconds since it began.
///
/// An exception of any function but layout(), which must not throw, stops the drive; the reason has its text.
/// Then deactivate() is called if the pilot was active, and nothing but layout() until the next start.
class Pilot {
 public:
  static constexpr double kByState = -1.0;  ///< value of nextChange() for closed-loop control

  virtual ~Pilot() = default;
  /// The thrusters that it commands.
  virtual const ThrusterLayout& layout() const { return *thrusterPair(); }
  /// Acceleration of a craft at rest by thrusters with these inputs at `time` (clock of stamps) [s], body
  /// axes [m/s^2], for the fence, rather too large; 0 if the craft is unknown.
  virtual Vector2<double> acceleration(double /*time*/, const Inputs& /*inputs*/) const { return {0, 0}; }
  /// Called with every command that is sent, by any controller, in order of time (clock of stamps)
  /// [s].
  virtual void commanded(double /*time*/, const Inputs& /*inputs*/) {}
  /// The voltage of the battery from now on [V], as the craft measures it.
  virtual void voltage(double /*volts*/) {}
  /// Sets the start of the drive, at which the model's t is 0; see DriveClock::record.
  virtual void driveBegan(double /*began*/, double /*as_of*/) {}
  /// Called when driving begins, at the time `stamp`; not active if it throws.
  virtual void activate(double /*stamp*/) {}
  /// Called when driving ends, for any reason.
  virtual void deactivate() {}
  /// Called with every valid state, while it is active.
  virtual void observe(const MeasuredState& /*measured*/) {}
  /// Reason to stop, or an empty string to continue. Called with every state and before every
  /// closed-loop update.
  virtual std::string objection(const MeasuredState& /*measured*/) { return ""; }
  /// The inputs from now on; `lift`: lift input of the parameters, 0..1.
  virtual Inputs update(double elapsed, double stamp, const RigidState<double>& state, double lift) = 0;
  /// Elapsed time at which it is done [s].
  virtual double end() const { return std::numeric_limits<double>::infinity(); }
  /// Elapsed time of the next change of open-loop inputs [s], or kByState for closed-loop control,
  /// which updates with each state, at most at `rate`. Called after every state and update, and
  /// also before activation if no state is required.
  virtual double nextChange(double /*elapsed*/) const { return kByState; }
  /// Warning for the user who starts it; empty if there is none.
  const std::string& caution() const { return caution_; }
  void setCaution(std::string caution) { caution_ = std::move(caution); }

 private:
  std::string caution_;
};

/// Life cycle of a controller: decides when it may drive, and what is sent otherwise. Nodelets and
/// simulated experiments use the same class. It reads no clock; the caller serialises the calls.
///
///     ControllerLifecycle life(pilot, send, changed);
///     life.setFence(Fence(room, room.margin));
///     life.start(now);
///     life.state(now, measured);  // every state
///     life.tick(now);             // not later than due(), also while no states come
///
/// It sends zeros before it is started, too, so that a sender can be armed. It stops the craft without the
/// help of another node, and is not the only one to do so: the sender has a fence of its own.
///
/// States: IDLE, WAITING (for a valid state and an armed sender), LIFTING, RUNNING, then DONE or
/// STOPPED. RUNNING changes to RECOVERING while the state is lost; LIFTING needs no state.
/// Thrust is sent only in RUNNING, lift in LIFTING, RUNNING and RECOVERING.
///
/// It stops if
/// - the state is stale or invalid for longer than recovery_time, or not finite,
/// - the state jumps by more than is physically possible,
/// - the craft would leave the room,
/// - the sender disarms,
/// - the clock was set,
/// - another controller takes over,
/// - the pilot objects or throws an exception, or
/// - a command is not finite.
///
/// If no state is required (LifecycleParams), only an open-loop pilot may drive.
class ControllerLifecycle {
 public:
  /// Numbers as in ground_msgs/ControllerStatus.
  enum class State { kIdle, kWaiting, kLifting, kRunning, kDone, kStopped, kRecovering };
  /// Sends a command.
  using Send = std::function<void(const Inputs&)>;
  /// Called when state or reason have changed.
  using Changed = std::function<void()>;
  static constexpr double kKeepalive = 0.02;  ///< interval of repeated commands [s]

  /// The pilot must outlive it.
  ControllerLifecycle(Pilot& pilot, Send send, Changed changed);

  /// Takes effect at once.
  void setParams(const LifecycleParams& params) { params_ = params; }
  const LifecycleParams& params() const { return params_; }
  /// Sets the fence that keeps the craft inside the room; without value, no bounds. Takes effect
  /// with the next state.
  void setFence(std::optional<Fence> fence) { guard_.setFence(std::move(fence)); }

  /// Starts the controller. Returns why it cannot be started, or an empty string.
  std::string start(Instant now);
  void stop(Instant now, const std::string& reason);
  /// Call with the sender's status: whether it is armed, and if not, why.
  void sender(Instant now, bool armed, const std::string& reason);
  /// Call when the other controller `name` sends a command. This one sends nothing at the same
  /// time. The controller that was started last drives: this one stops, or takes over with the lift
  /// on.
  void otherDrives(Instant now, const std::string& name, double lift);
  /// Call with every state.
  void state(Instant now, const MeasuredState& measured);
  /// Sends zero inputs, unless another controller drives.
  void sendZero(Instant now) { send(now, off(0)); }
  /// Call when the clock of stamps was set.
  void timeJumped(Instant now, const std::string& what);
  /// Calls what belongs to the pilot, unless that has thrown since the last start. An exception stops the
  /// drive with the next tick().
  template <class Call>
  void attempt(const Call& call) const {
    ask([&] { return call(), true; }, false);
  }
  /// The thrusters of the pilot.
  const ThrusterLayout& layout() const;
  /// Advances to now.
  void tick(Instant now);
  /// Latest time on each clock for the next tick(); infinite if unknown.
  Instant due() const;

  State current() const { return state_; }
  const std::string& reason() const { return reason_; }
  /// Whether it is started and not yet done or stopped.
  bool started() const { return state_ == State::kWaiting || state_ == State::kLifting || driving(); }
  /// Whether the pilot is active, including RECOVERING.
  bool driving() const { return state_ == State::kRunning || state_ == State::kRecovering; }
  /// Seconds since it began to drive.
  double elapsed(double time) const { return driving() ? time - running_since_ : 0; }

  /// Shows a visitor all that decides what the life cycle does next, as GroundLink::visit; times of the
  /// clock of stamps are marked so. A copy shares the pilot and the callbacks.
  template <class Visitor>
  void visit(Visitor&& visitor) const {
    for (const double t : {others_until_, next_keepalive_}) visitor.deadline(t);
    visitor.since(started_at_);
    visitor.value(lost_since_.has_value());
    if (lost_since_) visitor.since(*lost_since_);
    visitor.stamp(lifting_since_);
    visitor.stamp(running_since_);
    for (const std::optional<double>& t : {last_update_, change_at_}) {
      visitor.value(t.has_value());
      if (t) visitor.stamp(*t);
    }
    visitor.deadline(loss_.until(params_.state_timeout).steady);
    for (const std::optional<MeasuredState>* measured : {&measured_, &known_}) {
      visitor.value(measured->has_value());
      if (!*measured) continue;
      visitor.stamp((*measured)->stamp);
      visitor.value((*measured)->valid);
      for (int i = 0; i < 3; ++i) {
        visitor.value((*measured)->state.eta(i));
        visitor.value((*measured)->state.nu(i));
      }
    }
    guard_.visit(visitor);
    visitor.value(static_cast<int>(state_));
    for (const bool flag : {armed_, lifted_, silenced_, !failure_.empty()}) visitor.value(flag);
  }

 private:
  static constexpr double kNever = std::numeric_limits<double>::infinity();

  /// Result of a call of the pilot; `otherwise` if it throws or has thrown.
  template <class Call, class Result>
  Result ask(const Call& call, Result otherwise) const {
    if (silenced_) return otherwise;
    try {
      return call();
    } catch (const std::exception& error) {
      failure_ = error.what();
    } catch (...) {
      failure_.clear();
    }
    if (failure_.empty()) failure_ = "unknown exception";
    silenced_ = true;
    return otherwise;
  }
  double end() const;
  double nextChange(double elapsed) const;
  bool failed(Instant now);
  bool objects(Instant now);
  std::string deactivated();
  /// Whether the lift is on.
  bool flying() const { return state_ == State::kLifting || driving(); }
  std::string stateProblem(Instant now) const;
  bool stateIsFinite() const { return measured_ && measured_->finite(); }
  void stopIfJumped(Instant now);
  std::string jumped(const MeasuredState& state) const;
  bool bridge(Instant now, const std::string& problem);
  void act(Instant now);
  void schedule(double elapsed);
  void begin(Instant now);
  void control(Instant now, double stamp);
  void enter(Instant now, State state, const std::string& reason);
  void change(State state, const std::string& reason);
  void send(Instant now, const Inputs& inputs);
  Inputs off(double lift) const { return Inputs::off(layout().size(), lift); }
  double liftAlone() const;
  double liftedAt() const;
  double repeatAt() const;

  Pilot& pilot_;
  Send send_;
  Changed changed_;
  LifecycleParams params_;
  State state_ = State::kIdle;
  std::string reason_ = "not started yet";
  FenceGuard guard_;
  bool armed_ = false;
  std::optional<MeasuredState> measured_;
  StateLoss loss_;                                ///< of measured_
  std::optional<MeasuredState> known_;            ///< the last state used for control
  double lifting_since_ = 0, running_since_ = 0;  ///< clock of stamps [s]
  std::optional<double> last_update_;             ///< stamp [s]
  /// Next change of open-loop inputs, clock of stamps [s]; no value for closed-loop control.
  std::optional<double> change_at_;
  double started_at_ = 0;          ///< steady clock [s]
  double others_until_ = -kNever;  ///< until then another controller counts as driving [s]
  bool lifted_ = false;            ///< the lift was on when it took over from another controller
  /// Time of the loss of the state, steady clock [s]; no value while there is a valid state.
  std::optional<double> lost_since_;
  double next_keepalive_ = -kNever;  ///< steady clock [s]
  mutable bool silenced_ = false;    ///< the pilot has thrown: it is not called before the next start
  mutable std::string failure_;      ///< what it has thrown, until the drive is stopped
};

/// Name for messages and logs, such as "RUNNING".
const char* nameOf(ControllerLifecycle::State state);

}  // namespace ground
