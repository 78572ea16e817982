// What the documentation promises of the link, as a second implementation: which state it must be in, which
// commands it may send and to whom. The search compares GroundLink with it after every call.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <string>

#include "ground/safety/ground_link.h"

namespace ground {
namespace link_search {

struct LinkSpec {
  using State = GroundLink::State;
  static constexpr double kNever = -std::numeric_limits<double>::infinity();
  static constexpr double kSendTimeout = 0.2, kReturn = 2.0, kAhead = 1.0;  ///< [s]

  GroundLinkParams params;
  int thrusters = 2;
  State state = State::kDisarmed;
  bool stopped = false;
  std::optional<double> silent_until, lost_since, broken_since;
  double measured = kNever, issued = kNever, clash_until = kNever;
  bool valid = false, in_room = true;
  MotorCommand accepted;
  bool refused = false;  ///< the newest command of the controller was
  std::string source, armed_source;
  UdpAddress fixed, craft;  ///< address as given, and as known
  bool speaks = false, locked = false;
  double heard = kNever, counted = kNever;
  std::optional<std::uint32_t> count;  ///< the largest since the craft has started
  std::optional<std::uint32_t> boot;
  bool fell = false;  ///< the newest count was below it

  bool armed() const { return state == State::kArmed; }
  bool supported(double now) const {
    return !params.require_state || (valid && now < measured + params.state_timeout);
  }
  bool commanded(double now) const { return now < issued + params.command_timeout; }
  bool craftSilent(double now) const {
    return speaks && params.craft_timeout > 0 && now - heard > params.craft_timeout;
  }
  /// Whether a command may be on the wire.
  bool mayDrive(double now) const {
    return armed() && !silent_until && !lost_since && supported(now) && commanded(now);
  }

  /// What is sent while the state is lost: the lift stays on, so that thrust never comes before it.
  MotorCommand blind() const { return MotorCommand::off(thrusters, accepted.lift); }

  void end(State how) {
    state = how;
    silent_until.reset();
  }

  /// What time alone does.
  void pass(double now) {
    if (!armed()) return;
    if (silent_until && now >= *silent_until) return end(State::kDisarmed);
    if (!commanded(now)) return end(State::kFault);
    if (supported(now)) {
      lost_since.reset();
    } else {
      if (!lost_since) lost_since = now;
      const bool patient = params.recovery_time > 0 && !silent_until;
      if (!patient || now >= *lost_since + params.recovery_time) return end(State::kFault);
    }
    if (craftSilent(now)) end(State::kFault);
    if (armed() && broken_since && now >= *broken_since + kSendTimeout) end(State::kFault);
    if (armed() && !silent_until && count && params.obedience_timeout > 0 &&
        heard - counted > params.obedience_timeout)
      end(State::kFault);
  }

  /// Whether a command is accepted.
  bool command(double now, double age, const std::string& from, const MotorCommand& c) {
    pass(now);
    bool good =
        c.finite() && c.thrusters.size() == thrusters && age < params.command_timeout && age >= -kAhead;
    if (armed()) {
      good = good && from == armed_source;
      const bool pushes = *std::max_element(c.thrusters.begin(), c.thrusters.end()) > 0;
      if (params.require_lift && pushes && !(c.lift > 0)) good = false;
    }
    if (!good) {
      refused = refused || !armed() || from == armed_source;
      if (!armed()) issued = kNever;
      return false;
    }
    if (from != source && commanded(now)) clash_until = now + params.command_timeout;
    source = from;
    accepted = c;
    refused = false;
    issued = now - std::max(0.0, age);
    return true;
  }

  void measure(double now, double age, bool is_valid) {
    pass(now);
    valid = is_valid;
    measured = std::isfinite(age) && age >= -kAhead ? now - std::max(0.0, age) : kNever;
    pass(now);
  }

  void clockSet(double now) {
    pass(now);
    issued = measured = kNever;
    if (armed()) end(State::kFault);
  }

  /// Whether it must arm.
  bool arm(double now) {
    pass(now);
    if (stopped || silent_until) return false;
    if (armed()) return true;
    const bool ready = state == State::kDisarmed && craft.port != 0 && !broken_since && !craftSilent(now) &&
                       commanded(now) && accepted.zero() && clash_until <= now &&
                       (!params.require_state || (supported(now) && in_room));
    if (!ready) return false;
    state = State::kArmed;
    armed_source = source;
    locked = true;
    lost_since.reset();
    counted = now;
    return true;
  }

  /// Whether a silence must begin, if the packet before it can be sent.
  bool silence(double now, double duration) {
    pass(now);
    return armed() && !silent_until && !lost_since && duration > 0 && duration <= 2 &&
           accepted.thrust() <= 0.5;
  }

  /// Whether a datagram counts as the craft's.
  bool datagram(double now, const UdpAddress& from, bool telemetry) {
    if (from != craft) {
      const bool back = speaks && telemetry && from.host == craft.host && now - heard > kReturn;
      if (fixed.port != 0 || (fixed.known() && from.host != fixed.host)) return false;
      if (armed() || !(craft.port == 0 || (!locked && telemetry) || back)) return false;
      craft = from;
      count.reset();
      boot.reset();
      fell = false;
    }
    heard = now;
    return true;
  }
  /// A craft has restarted if its boot id is another, or its count is below the largest twice in a row: UDP
  /// repeats datagrams, and brings single ones late.
  void telemetry(double now, std::optional<std::uint32_t> commands, std::optional<std::uint32_t> boot_id) {
    speaks = locked = true;
    const bool booted = boot && boot_id && *boot != *boot_id;
    if (boot_id) boot = boot_id;
    if (booted) count.reset();
    const bool below = commands && count && *commands < *count, twice = below && fell;
    if (commands) fell = below && !twice;
    if (commands && !fell) {
      if (commands != count) counted = now;
      count = commands;
    }
    if ((booted || twice) && armed()) end(State::kFault);
  }

  template <class Visitor>
  void visit(Visitor&& v) const {
    v.deadline(measured + params.state_timeout);
    v.deadline(issued + params.command_timeout);
    v.deadline(clash_until);
    for (const std::optional<double>& t : {silent_until, lost_since, broken_since}) {
      v.value(t.has_value());
      if (t) v.since(*t);
    }
    v.since(heard);
    v.since(counted);
    for (const bool flag :
         {stopped, refused, valid, in_room, speaks, locked, count.has_value(), fell, boot.has_value()})
      v.value(flag);
    v.value(static_cast<int>(state));
    v.value(accepted.thrust());
    v.value(source);
    v.value(armed_source);
    v.value(craft.port);
    v.value(craft.host);
    v.value(params.state_timeout);
  }
};

}  // namespace link_search
}  // namespace ground
