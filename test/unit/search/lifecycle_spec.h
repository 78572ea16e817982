// What the documentation promises of a controller's life cycle, as a second implementation.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <vector>

#include "ground/safety/controller_lifecycle.h"

namespace ground {
namespace lifecycle_search {

struct LifecycleSpec {
  using State = ControllerLifecycle::State;
  static constexpr double kHandover = 0.2, kAhead = 1;  ///< [s]
  static constexpr double kJump = 0.2, kJumpSpeed = 2;  ///< [m], [m/s]
  static constexpr double kTurn = 0.6, kTurnRate = 10;  ///< [rad], [rad/s]

  /// A state, as far as it matters.
  struct Seen {
    double stamp, x, u, heading;
    bool valid, finite;
    bool ahead = false;  ///< its stamp is of another clock
  };
  /// Thrust from a time on, clock of stamps.
  struct Push {
    double since, acceleration;  ///< [s], [m/s^2]
  };

  LifecycleParams params;
  double end = std::numeric_limits<double>::infinity();  ///< length of the drive [s]
  bool closed_loop = true;
  State state = State::kIdle;
  bool armed = false, lifted = false;
  std::optional<Seen> seen, trusted;  ///< the last state, and the last one that is valid and finite
  Fence fence{Room(), 0.2};
  std::vector<Push> pushes;  ///< at the time of the last trusted state, and since then
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
    return seen && seen->valid && seen->finite && !seen->ahead &&
           now.steady < seen_at + params.state_timeout && now.time < seen->stamp + params.state_timeout;
  }
  bool maySend() const { return armed || !params.require_armed; }

  void know(const Seen& used) {
    known_x = used.x;
    known_u = used.u;
    known_heading = used.heading;
    known_stamp = used.stamp;
  }
  /// Notes a command on the wire by the acceleration that it causes.
  void sends(Instant now, double acceleration) {
    if (!trusted) pushes.clear();
    if (pushes.empty() || pushes.back().acceleration != acceleration)
      pushes.push_back({now.time, acceleration});
  }
  /// Whether the craft could leave the room, by the last trusted state or the last one, and all thrust since.
  bool leaves(Instant now) const {
    if (!params.require_state) return false;
    return (trusted && leavesFrom(now, *trusted)) || (seen && seen->finite && leavesFrom(now, *seen));
  }
  bool leavesFrom(Instant now, const Seen& from) const {
    Fence::Thrusts thrusts;
    for (std::size_t i = 0; i < pushes.size(); ++i) {
      const double until = i + 1 < pushes.size() ? pushes[i + 1].since : now.time;
      const double lasted = std::max(0.0, until - std::max(pushes[i].since, from.stamp));
      thrusts.push_back({{pushes[i].acceleration, 0}, lasted});
    }
    RigidState<double> craft{Vector3<double>(from.x, 0, from.heading), Vector3<double>(from.u, 0, 0)};
    return !fence.objection(craft, now.time - from.stamp, thrusts).empty();
  }

  /// Time to the next limit that a tick must not miss [s]; infinite if there is none.
  double untilLimit(Instant now) const {
    double left = std::numeric_limits<double>::infinity();
    if (state == State::kLifting && !lost_since) left = std::min(left, lifting_since + liftTime() - now.time);
    if (driving()) left = std::min(left, running_since + end - now.time);
    if (flying() && lost_since) left = std::min(left, *lost_since + params.recovery_time - now.steady);
    if (flying() && !lost_since && seen && params.require_state)
      left = std::min(
          {left, seen_at + params.state_timeout - now.steady, seen->stamp + params.state_timeout - now.time});
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
      const bool patient = params.recovery_time > 0 && seen && seen->finite;
      if (!patient || now.steady >= *lost_since + params.recovery_time) change(State::kStopped);
    }
    if (flying() && leaves(now)) change(State::kStopped);
    if (state == State::kLifting && good && now.time >= lifting_since + liftTime()) {
      state = State::kRunning;
      running_since = now.time;
      if (seen) know(*seen);
    }
    if (driving() && now.time >= running_since + end) change(State::kDone);
  }

  /// The clock of stamps was set: what was seen and pushed by it counts no more.
  void clockSet() {
    if (flying()) change(State::kStopped);
    seen.reset();
    trusted.reset();
    pushes.clear();
  }

  void measure(Instant now, const Seen& measured) {
    if (!params.require_state) return;
    seen = measured;
    seen->ahead = measured.stamp > now.time + kAhead;
    seen_at = now.steady;
    if (measured.valid && measured.finite) {
      trusted = measured;
      while (pushes.size() > 1 && pushes[1].since <= measured.stamp) pushes.erase(pushes.begin());
    }
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
    if (seen) v.deadline(seen_at + params.state_timeout);
    for (const Push& one : pushes) {
      v.stamp(trusted ? std::max(one.since, trusted->stamp) : one.since);
      v.value(one.acceleration);
    }
    for (const bool flag : {armed, lifted, seen && seen->valid, seen && seen->finite, seen && seen->ahead})
      v.value(flag);
  }
};

}  // namespace lifecycle_search
}  // namespace ground
