// What the documentation promises of a controller's life cycle, as a second implementation.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "fence_spec.h"
#include "ground/safety/controller_lifecycle.h"

namespace ground {
namespace lifecycle_search {

struct LifecycleSpec {
  using State = ControllerLifecycle::State;
  static constexpr double kHandover = 0.2;              ///< [s]
  static constexpr double kJump = 0.2, kJumpSpeed = 2;  ///< [m], [m/s]
  static constexpr double kTurn = 0.6, kTurnRate = 10;  ///< [rad], [rad/s]

  using Seen = search::FenceSpec::Seen;

  LifecycleParams params;
  double end = std::numeric_limits<double>::infinity();  ///< length of the drive [s]
  bool closed_loop = true;
  State state = State::kIdle;
  bool armed = false, lifted = false;
  search::FenceSpec room{Fence(Room(), 0.2), {}, {}, {}};
  double known_x = 0, known_u = 0, known_heading = 0,
         known_stamp = 0;  ///< of the last state used for control
  double seen_at = 0, started_at = 0, others_until = -1e9;
  double lifting_since = 0, running_since = 0;  ///< clock of stamps [s]
  std::optional<double> lost_since;

  bool driving() const { return state == State::kRunning || state == State::kRecovering; }
  bool flying() const { return state == State::kLifting || driving(); }
  bool started() const { return state == State::kWaiting || flying(); }
  bool othersDrive(Instant now) const { return !started() && now.steady < others_until; }
  double liftTime() const { return lifted ? 0 : params.lift_time; }

  /// Whether the state allows driving.
  bool supported(Instant now) const {
    if (!params.require_state) return true;
    const std::optional<Seen>& seen = room.seen;
    return seen && seen->trusted() && now.steady < seen_at + params.state_timeout &&
           now.time < seen->stamp + params.state_timeout;
  }
  bool maySend() const { return armed || !params.require_armed; }

  void know(const Seen& used) {
    known_x = used.x;
    known_u = used.u;
    known_heading = used.heading;
    known_stamp = used.stamp;
  }
  /// Time to the next limit that a tick must not miss [s]; infinite if there is none.
  double untilLimit(Instant now) const {
    double left = std::numeric_limits<double>::infinity();
    if (state == State::kLifting && !lost_since) left = std::min(left, lifting_since + liftTime() - now.time);
    if (driving()) left = std::min(left, running_since + end - now.time);
    if (flying() && lost_since) left = std::min(left, *lost_since + params.recovery_time - now.steady);
    if (flying() && !lost_since && room.seen && params.require_state)
      left = std::min({left, seen_at + params.state_timeout - now.steady,
                       room.seen->stamp + params.state_timeout - now.time});
    return left;
  }

  void change(State to) {
    state = to;
    if (!flying()) lost_since.reset();
  }

  /// What time alone does.
  void pass(Instant now) {
    const bool good = supported(now);
    if (state == State::kWaiting && good && maySend()) {
      state = State::kLifting;
      lifting_since = now.time;
    }
    if (flying() && good) {
      lost_since.reset();
      if (state == State::kRecovering) state = State::kRunning;
    } else if (flying()) {
      if (!lost_since) lost_since = now.steady;
      if (state == State::kRunning) state = State::kRecovering;
      const bool patient = params.recovery_time > 0 && room.seen && room.seen->finite;
      if (!patient || now.steady >= *lost_since + params.recovery_time) change(State::kStopped);
    }
    if (flying() && room.leaves(now.time)) change(State::kStopped);
    if (state == State::kLifting && good && now.time >= lifting_since + liftTime()) {
      state = State::kRunning;
      running_since = now.time;
      if (room.seen) know(*room.seen);
    }
    if (driving() && now.time >= running_since + end) change(State::kDone);
  }

  /// The clock of stamps was set: what was seen and pushed by it counts no more.
  void clockSet() {
    if (flying()) change(State::kStopped);
    room.clockSet();
  }

  void measure(Instant now, const Seen& measured) {
    if (!params.require_state) return;
    room.measure(now.time, measured);
    seen_at = now.steady;
    if (driving() && measured.valid && measured.finite) {
      const double dt = std::max(0.0, measured.stamp - known_stamp);
      const bool jumped = std::abs(measured.x - known_x - known_u * dt) > kJump + kJumpSpeed * dt ||
                          std::abs(measured.heading - known_heading) > kTurn + kTurnRate * dt;
      know(measured);
      if (jumped) change(State::kStopped);
    }
    pass(now);
  }

  /// Whether it must start.
  bool start(Instant now) {
    if (started() || (!params.require_state && closed_loop)) return false;
    started_at = now.steady;
    lifted = lifted && others_until > now.steady;
    others_until = -1e9;  // the other one stops as soon as it hears of this one
    state = State::kWaiting;
    return true;
  }

  void sender(bool is_armed) {
    armed = is_armed;
    if (params.require_armed && !armed && flying()) change(State::kStopped);
  }

  void otherDrives(Instant now, double lift) {
    if (!started()) {
      others_until = now.steady + kHandover;
      lifted = lift > 0;
    } else if (now.steady - started_at > kHandover) {
      others_until = now.steady + kHandover;
      change(State::kStopped);
    }
  }

  template <class Visitor>
  void visit(Visitor&& v) const {
    v.value(static_cast<int>(state));
    v.deadline(others_until);
    v.value(lost_since.has_value());
    if (lost_since) v.since(*lost_since);
    if (room.seen) v.deadline(seen_at + params.state_timeout);
    room.visit(v);
    v.value(armed);
    v.value(lifted);
  }
};

}  // namespace lifecycle_search
}  // namespace ground
