#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>

#include "ground/model/thruster.h"
#include "ground/parameters/GroundLinkFields.h"
#include "ground/safety/craft_telemetry.h"
#include "ground/safety/freshness.h"
#include "ground/safety/udp_address.h"

namespace ground {

/// Timeouts and rates of the link, and whether driving needs a valid state inside the room; false only
/// for a bench where the craft is fastened.
struct GroundLinkParams : GroundLinkFields {
  bool require_state = true;
};

/// The ground's end of the link to the craft. Identifies the craft, and decides whether it may
/// move.
///
/// - DISARMED sends zero packets.
/// - ARMED sends commands, each at once and again at the keepalive rate. It needs a known craft, a
///   fresh valid state and a fresh zero command of a single controller.
/// - FAULT sends zero packets and lasts until disarmed by hand. ARMED changes to FAULT if commands
///   are stale, packets cannot be sent, or the state is stale or invalid for recovery_time; until
///   then it sends the lift of the commands without their thrust. It also changes to
///   FAULT if the craft counts received commands and its count does not increase, or if the craft
///   has restarted: its boot id changes, or its count is lower in two datagrams in a row.
///
/// A silence tests whether the craft stops by itself: while ARMED no packet is sent for a bounded
/// time, then the link is DISARMED. A fault, disarm or stop ends the silence early and sends zeros
/// at once. Commands that arrive during the silence are never sent.
///
/// All times are on one steady clock [s]; the caller supplies them, and serialises the calls.
class GroundLink {
 public:
  enum class State { kDisarmed, kArmed, kFault };
  static constexpr double kLongestSilence = 2.0;   ///< [s]
  static constexpr double kMaxSilentThrust = 0.5;  ///< largest input at the start of a silence
  struct Counters {
    std::uint64_t sent = 0, received = 0, malformed = 0, foreign = 0, refused = 0;
  };
  /// Sends a command to the craft; returns an error message, or an empty string.
  using Send = std::function<std::string(const MotorCommand& command, const UdpAddress& to)>;

  /// `layout`: the thrusters of the craft. `peer`: its address if fixed (port 0: any port); unknown
  /// if it is learned from the first datagram. Throws std::invalid_argument if params are bad.
  GroundLink(const GroundLinkParams& params, const UdpAddress& peer, Send send,
             ThrusterLayoutPtr layout = thrusterPair());

  /// Throws std::invalid_argument, and keeps the old parameters, if the new ones are bad.
  void setParams(const GroundLinkParams& params);
  const GroundLinkParams& params() const { return params_; }

  /// Call with every received datagram; `telemetry`: what it contains, no value if it cannot be read. Returns
  /// whether it is telemetry of the craft.
  bool datagram(double now, const std::optional<CraftTelemetry>& telemetry, const UdpAddress& from);
  /// Call with every command. `source`: name of the controller; `age`: time since it was issued
  /// [s], negative for a stamp in the future. Refuses and counts a command that is not finite, for
  /// other thrusters than the craft's, too old, more than a second ahead or, while armed,
  /// not from the controller that the link was armed with.
  void command(double now, double age, const std::string& source, const MotorCommand& command);
  /// Call with a command that is not for this craft; `why` says so. It is refused and counted.
  void refuseCommand(double now, const std::string& source, const std::string& why);
  /// Call with every state, measured `age` seconds ago (stale if more than a second in the future).
  /// `problem`: why it is invalid.
  void state(double now, double age, bool valid, const std::string& problem = "");
  /// Call when the clock of the stamps was set; `what` describes the jump. Earlier commands and
  /// states become stale, and an armed link goes to FAULT.
  void timeJumped(double now, const std::string& what);
  /// Call when the craft does not follow its commands; `how` describes its motion. A fault while
  /// armed.
  void disobeyed(double now, const std::string& how);
  /// Call with every state, and between states while armed; `problem`: why the craft does not stay in
  /// the room, or empty. A problem is a fault while armed, and prevents arming.
  void confine(double now, const std::string& problem);
  /// Arms. Returns why it could not, or an empty string. `remark` is appended to reason() while
  /// armed.
  std::string arm(double now, const std::string& remark = "");
  /// Repeats the current command once, sends nothing for `duration` seconds (at most
  /// kLongestSilence), then disarms. Returns why it could not, or an empty string.
  std::string silence(double now, double duration);
  void disarm(double now, const std::string& reason);
  /// Disarms permanently: only zero packets are sent from now on.
  void stop(double now, const std::string& reason);
  /// Checks timeouts and repeats packets. Call at least at the keepalive rate.
  void tick(double now);
  /// Sends one zero packet to the craft, if it is known.
  void sendZero(double now);

  State current() const { return state_; }
  /// Commanded lift, 0..1, also during a temporary loss of the state.
  double lift() const {
    if (state_ != State::kArmed) return 0.0;
    return silent_until_ ? sent_.lift : command_.lift;
  }
  const std::string& reason() const { return reason_; }
  /// The craft's address; port 0 if unknown.
  const UdpAddress& peer() const { return peer_; }
  const Counters& counters() const { return counters_; }
  /// Why the last refused command was refused; empty if none was.
  const std::string& refusal() const { return refusal_; }
  /// Why packets cannot be sent; empty if they can.
  const std::string& sendProblem() const { return send_problem_; }
  /// The command of the last packet.
  const MotorCommand& sent() const { return sent_; }
  /// Time of the next packet [s].
  double nextPacket() const { return next_packet_; }
  /// Increases from 0 with every change of state, reason or craft.
  std::uint64_t revision() const { return revision_; }

  /// Shows a visitor all that decides what the link does next: `deadline(t)` a time that counts until
  /// it has passed, `since(t)` the time of an event, `value(v)` a flag, a number or a name. Links of
  /// which a visitor sees the same, relative to now, behave the same. A copy of a link is another
  /// link that shares its Send.
  template <class Visitor>
  void visit(Visitor&& visitor) const {
    for (const Instant& end : {commands_.until(params_.command_timeout), loss_.until(params_.state_timeout)})
      visitor.deadline(std::min(end.steady, end.time));
    for (const double t : {clash_until_, next_packet_}) visitor.deadline(t);
    if (silent_until_) visitor.deadline(*silent_until_);
    if (!send_problem_.empty()) visitor.deadline(sent_until_);
    for (const double t : {peer_heard_, peer_counted_, lost_since_}) visitor.since(t);
    for (const bool flag :
         {peer_speaks_, peer_locked_, peer_count_.has_value(), peer_boot_.has_value(), peer_fell_, stopped_,
          silent_until_.has_value(), loss_.valid(), !room_problem_.empty(), !send_problem_.empty()})
      visitor.value(flag);
    for (const MotorCommand* command : {&command_, &sent_}) {
      for (const double input : command->thrusters) visitor.value(input);
      visitor.value(command->lift);
    }
    visitor.value(static_cast<int>(state_));
    visitor.value(peer_.host);
    visitor.value(peer_.port);
    visitor.value(command_source_);
    visitor.value(armed_source_);
  }

 private:
  bool isCraft(double now, const UdpAddress& from, bool telemetry);
  bool restarted(double now, const CraftTelemetry& telemetry);
  std::string objection(double age, const std::string& source, const MotorCommand& command) const;
  void watch(double now);
  std::string stateLoss(double now) const { return loss_.problem({now, now}, params_.state_timeout); }
  std::string craftMissing(double now) const;
  std::string stateMissing(double now) const;
  std::string commandMissing(double now) const;
  void watchState(double now);
  bool commandsStale(double now) const { return commands_.stale({now, now}, params_.command_timeout); }
  bool craftSilent(double now) const;
  bool receivesNoCommands() const;
  void enter(State state, const std::string& reason);
  void fault(double now, const std::string& reason);
  void transmit(double now);
  void sendPacket(double now, const MotorCommand& command);

  GroundLinkParams params_;
  Send send_;
  ThrusterLayoutPtr layout_;
  UdpAddress fixed_;  ///< the craft's address as given by the caller
  UdpAddress peer_;
  bool peer_speaks_ = false;  ///< the peer has sent a DroneState
  bool peer_locked_ = false;  ///< the peer is certainly the craft: it has sent one, or was armed
  double peer_heard_;         ///< time of the craft's last datagram
  std::optional<std::uint32_t> peer_count_;  ///< commands counted by the craft since its start, if it does
  std::optional<std::uint32_t> peer_boot_;   ///< boot id of the craft, if it has one
  bool peer_fell_ = false;                   ///< the newest count was below peer_count_
  double peer_counted_;                      ///< time of the last change of the count, or of arming
  State state_ = State::kDisarmed;
  bool stopped_ = false;
  std::string reason_ = "not armed yet";
  MotorCommand sent_, command_;  ///< last packet, last accepted command
  std::string command_source_, armed_source_;
  std::string armed_reason_;
  std::optional<double> silent_until_;  ///< end of the silence; set only while armed
  std::string command_problem_;         ///< why the controller's newest command is not command_
  Freshness commands_;                  ///< of command_
  double clash_until_;                  ///< time at which a second controller counts as stopped
  std::string clash_;
  StateLoss loss_;
  double lost_since_;  ///< time at which the state was lost while armed; kNever if it is valid
  std::string room_problem_;
  std::string refusal_;
  std::string send_problem_;
  double sent_until_;  ///< time at which a failure to send becomes a fault
  double next_packet_;
  std::uint64_t revision_ = 0;
  Counters counters_;
};

}  // namespace ground
