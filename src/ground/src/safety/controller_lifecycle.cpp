#include "ground/safety/controller_lifecycle.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <exception>
#include <limits>
#include <utility>

namespace ground {
namespace {

constexpr double kHandover = 0.2;  // silence after which another controller counts as stopped [s]
const std::string kFailed = "the controller failed: ";
constexpr const char* kNeedsState = "it drives by the state, and require_state is false";

/// State for pilots that drive without one. A pilot that uses it by mistake computes NaN commands.
RigidState<double> noState() {
  RigidState<double> state;
  state.eta.setConstant(std::numeric_limits<double>::quiet_NaN());
  state.nu.setConstant(std::numeric_limits<double>::quiet_NaN());
  return state;
}

}  // namespace

const char* nameOf(ControllerLifecycle::State state) {
  static const char* names[] = {"IDLE", "WAITING", "LIFTING", "RUNNING", "DONE", "STOPPED", "RECOVERING"};
  return names[static_cast<int>(state)];
}

ControllerLifecycle::ControllerLifecycle(Pilot& pilot, Send send, Changed changed)
    : pilot_(pilot), send_(std::move(send)), changed_(std::move(changed)) {}

std::string ControllerLifecycle::start(Instant now) {
  if (started()) return "it has been started already";
  silenced_ = false;
  failure_.clear();
  const bool by_state = !params_.require_state && nextChange(0) == Pilot::kByState;
  if (silenced_) return kFailed + std::exchange(failure_, "");
  if (by_state) return kNeedsState;
  started_at_ = now.steady;
  lifted_ = lifted_ && others_until_ > started_at_;
  others_until_ = -kNever;  // the other one stops at the first command of this one
  enter(now, State::kWaiting,
        params_.require_state ? "waits for a valid state and an armed sender" : "waits for an armed sender");
  return "";
}

void ControllerLifecycle::stop(Instant now, const std::string& reason) {
  enter(now, State::kStopped, reason);
}

void ControllerLifecycle::sender(Instant now, bool armed, const std::string& reason) {
  armed_ = armed;
  if (params_.require_armed && !armed_ && (state_ == State::kLifting || driving()))
    enter(now, State::kStopped, "the sender is not armed: " + reason);
}

void ControllerLifecycle::otherDrives(Instant now, const std::string& name, double lift) {
  if (!started()) {
    others_until_ = now.steady + kHandover;
    lifted_ = lift > 0;
  } else if (now.steady - started_at_ > kHandover) {  // earlier: late command of the replaced one
    others_until_ = now.steady + kHandover;
    change(State::kStopped, name + " has taken over");  // sends nothing to the craft
  }
}

void ControllerLifecycle::state(Instant now, const MeasuredState& measured) {
  if (!params_.require_state) return;
  measured_ = measured;
  loss_.received(now, measured.stamp, measured.valid, measured.problem);
  guard_.state(now.time, measured);
  if (measured.valid && stateIsFinite() && driving()) stopIfJumped(now);
  tick(now);
  if (state_ == State::kRunning && change_at_) {
    if (objects(now)) return;
    if (nextChange(elapsed(now.time)) == Pilot::kByState && !failed(now)) {
      change_at_.reset();
      last_update_.reset();  // the first closed-loop update is due at once
    }
  }
  if (state_ != State::kRunning || change_at_) return;
  // A tenth of tolerance, so that jitter does not skip every other state.
  if (!last_update_ || measured.stamp - *last_update_ >= 0.9 / params_.rate) control(now, measured.stamp);
}

/// Takes the last state as what is known of the craft; stops if it cannot have moved there.
void ControllerLifecycle::stopIfJumped(Instant now) {
  const std::string jump = jumped(*measured_);
  known_ = measured_;
  if (!jump.empty()) enter(now, State::kStopped, jump);
  if (driving()) attempt([&] { pilot_.observe(*measured_); });
}

void ControllerLifecycle::timeJumped(Instant now, const std::string& what) {
  measured_.reset();  // of the clock as it was
  loss_.reset();
  guard_.reset();
  if (flying()) enter(now, State::kStopped, what);
}

void ControllerLifecycle::tick(Instant now) {
  const std::string problem = stateProblem(now);
  const bool ready = problem.empty() && (armed_ || !params_.require_armed);
  if (state_ == State::kWaiting && ready) {
    lifting_since_ = now.time;
    enter(now, State::kLifting, "lift on");
  }
  if (flying() && !bridge(now, problem)) enter(now, State::kStopped, problem);
  if (flying()) {
    const std::string leaving = guard_.objection(now.time);
    if (!leaving.empty()) enter(now, State::kStopped, leaving);
  }
  if (state_ == State::kLifting && problem.empty() && now.time >= liftedAt()) begin(now);
  if (driving() && now.time >= running_since_ + end()) enter(now, State::kDone, "came to its end");
  if (!failed(now)) act(now);
}

/// Computes or repeats a command if one is due.
void ControllerLifecycle::act(Instant now) {
  const bool repeats = now.steady >= repeatAt();
  if (state_ == State::kRunning) {
    // Without a new state it uses the last one, until that is stale.
    const double upon = change_at_ || !measured_ ? now.time : measured_->stamp;
    if (repeats || (change_at_ && now.time >= *change_at_)) control(now, upon);
  } else if (repeats) {
    send(now, off(driving() ? params_.lift : liftAlone()));
  }
}

Instant ControllerLifecycle::due() const {
  Instant due{repeatAt(), kNever};
  const bool lost = lost_since_.has_value();
  if (measured_ && !lost && (state_ == State::kLifting || state_ == State::kRunning)) {
    const Instant stale = loss_.until(params_.state_timeout);
    due.steady = std::min(due.steady, stale.steady);
    due.time = std::min(due.time, stale.time);
  }
  if (state_ == State::kLifting && !lost) due.time = std::min(due.time, liftedAt());
  if (driving()) due.time = std::min(due.time, running_since_ + end());
  if (state_ == State::kRunning && change_at_) due.time = std::min(due.time, *change_at_);
  if (lost) due.steady = std::min(due.steady, *lost_since_ + params_.recovery_time);
  return due;
}

std::string ControllerLifecycle::stateProblem(Instant now) const {
  if (!params_.require_state) return "";
  const std::string lost = loss_.problem(now, params_.state_timeout);
  return lost.empty() && !stateIsFinite() ? "the state is not finite" : lost;
}

/// Error message if the craft cannot have moved to this state from the last one used for control:
/// it was carried, or the mocap tracks something else. Otherwise empty.
std::string ControllerLifecycle::jumped(const MeasuredState& state) const {
  if (!known_) return "";
  // Limits for a short gap, and their increase with time. They are stricter than sameMotion(), which
  // does not use the velocity.
  constexpr double kWay = 0.2, kSpeed = 2.0;     // [m], [m/s]
  constexpr double kTurn = 0.6, kTurnRate = 10;  // [rad], [rad/s]
  const RigidState<double>&from = known_->state, &to = state.state;
  const double dt = std::max(0.0, state.stamp - known_->stamp);
  const Vector2<double> over_floor = bodyToWorld<double>(from.eta.z(), from.nu.head<2>().eval());
  const double way = (to.eta.head<2>() - from.eta.head<2>() - over_floor * dt).norm();
  const double turn = std::abs(wrapAngle(to.eta.z() - from.eta.z() - from.nu.z() * dt));
  if (way <= kWay + kSpeed * dt && turn <= kTurn + kTurnRate * dt) return "";
  char text[120];
  std::snprintf(text, sizeof text, "the state has jumped by %.2f m and %.2f rad in %.2f s", way, turn, dt);
  return text;
}

/// Sets the thrust to zero while the state is lost; returns false if it is lost for too long.
bool ControllerLifecycle::bridge(Instant now, const std::string& problem) {
  if (problem.empty()) {
    lost_since_.reset();
    if (state_ == State::kRecovering) change(State::kRunning, "driving again");
    return true;
  }
  if (!stateIsFinite() || params_.recovery_time == 0) return false;
  if (!lost_since_) lost_since_ = now.steady;
  const double until = *lost_since_ + params_.recovery_time;
  if (state_ == State::kRunning) {
    change(State::kRecovering, "no thrust until the state is back: " + problem);
    send(now, off(params_.lift));
  }
  return now.steady < until;
}

void ControllerLifecycle::schedule(double elapsed) {
  const double next = nextChange(elapsed);
  change_at_ = next == Pilot::kByState ? std::nullopt : std::make_optional(running_since_ + next);
}

void ControllerLifecycle::begin(Instant now) {
  running_since_ = now.time;
  last_update_.reset();
  known_ = measured_;
  attempt([&] { pilot_.activate(now.time); });
  if (!failure_.empty()) return enter(now, State::kStopped, std::exchange(failure_, ""));
  const std::string remark = pilot_.caution();
  change(State::kRunning, remark.empty() ? "driving" : "driving; " + remark);
  schedule(0);
  if (change_at_) change_at_ = now.time;  // its first inputs are due at once
}

void ControllerLifecycle::control(Instant now, double stamp) {
  if (!change_at_ && !params_.require_state) return enter(now, State::kStopped, kNeedsState);
  // By the mocap's latency, the state may be older than the start.
  const double elapsed = std::max(0.0, stamp - running_since_);
  if (!change_at_ && objects(now)) return;
  const RigidState<double> state = params_.require_state ? measured_->state : noState();
  const Inputs inputs =
      ask([&] { return pilot_.update(elapsed, stamp, state, params_.lift); }, off(params_.lift));
  last_update_ = stamp;
  schedule(elapsed);
  if (failed(now)) return;
  const int count = inputs.thrusters.size(), thrusters = layout().size();
  if (count != thrusters)
    return enter(
        now, State::kStopped,
        "the command is for " + std::to_string(count) + " thrusters, not " + std::to_string(thrusters));
  if (!inputs.finite()) return enter(now, State::kStopped, "the command is not finite");
  send(now, inputs);
}

void ControllerLifecycle::enter(Instant now, State state, const std::string& reason) {
  change(state, reason);
  send(now, off(liftAlone()));
}

void ControllerLifecycle::change(State state, const std::string& reason) {
  const bool was_driving = driving();
  state_ = state;
  reason_ = reason;
  if (!driving() && state_ != State::kLifting) lost_since_.reset();
  if (was_driving && !driving()) {
    const std::string failure = deactivated();
    if (!failure.empty()) state_ = State::kStopped;
    if (!failure.empty()) reason_ += "; " + kFailed + failure;
  }
  changed_();
}

/// Deactivates the pilot, also one that has thrown. Returns what it throws now, or an empty string.
std::string ControllerLifecycle::deactivated() {
  const bool had_thrown = std::exchange(silenced_, false);
  attempt([&] { pilot_.deactivate(); });
  silenced_ = silenced_ || had_thrown;
  return std::exchange(failure_, "");
}

/// Stops the drive if the pilot has thrown since the last call; returns whether it has.
bool ControllerLifecycle::failed(Instant now) {
  if (failure_.empty()) return false;
  enter(now, State::kStopped, kFailed + std::exchange(failure_, ""));
  return true;
}

/// Stops the drive if the pilot objects to the last state; returns whether it has stopped.
bool ControllerLifecycle::objects(Instant now) {
  const std::string reason = ask([&] { return pilot_.objection(*measured_); }, std::string());
  if (!failed(now) && !reason.empty()) enter(now, State::kStopped, reason);
  return !driving();
}

double ControllerLifecycle::end() const {
  return ask([&] { return pilot_.end(); }, std::numeric_limits<double>::infinity());
}

double ControllerLifecycle::nextChange(double elapsed) const {
  return ask([&] { return pilot_.nextChange(elapsed); }, Pilot::kByState);
}

const ThrusterLayout& ControllerLifecycle::layout() const { return pilot_.layout(); }

void ControllerLifecycle::send(Instant now, const Inputs& inputs) {
  next_keepalive_ = now.steady + kKeepalive;
  if (!started() && now.steady < others_until_) return;
  guard_.sent(now.time, ask([&] { return pilot_.acceleration(now.time, inputs); }, Vector2<double>(0, 0)));
  if (!failed(now)) send_(inputs);
}

/// Lift input while the thrusters are off; a controller that takes over keeps the lift on.
double ControllerLifecycle::liftAlone() const {
  const bool on = state_ == State::kLifting || (state_ == State::kWaiting && lifted_);
  return on ? params_.lift : 0.0;
}

double ControllerLifecycle::liftedAt() const { return lifting_since_ + (lifted_ ? 0 : params_.lift_time); }

/// Time to repeat the last command. A closed-loop controller first waits for the next state.
double ControllerLifecycle::repeatAt() const {
  const bool waits = state_ == State::kRunning && !change_at_;
  return next_keepalive_ + (waits ? 1 / params_.rate : 0);
}

}  // namespace ground
