#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>

#include "ground/link/protocol.h"
#include "ground/link/udp_socket.h"

namespace ground {

/// When the link gives up on its sources, and how often it repeats itself.
struct GroundLinkParams {
  double command_timeout = 0.2;  ///< oldest command that is still obeyed [s]
  double state_timeout = 0.2;    ///< oldest state with which the craft may be driven [s]
  double recovery_time = 0.0;    ///< without a state that zero packets bridge before a fault [s]
  double keepalive_rate = 50.0;  ///< packets per second when nothing new comes [Hz]
  /// Silence of a craft that used to send telemetry after which it may come back on another port
  /// [s].
  double peer_timeout = 2.0;
  double craft_timeout = 2.0;  ///< such silence before a fault, 0 for none [s]
  /// The craft may not do as told for so long before a fault, 0 for ever [s].
  double obedience_timeout = 1.0;
  double send_timeout = 0.2;  ///< longest that the system may refuse to send while armed [s]
  /// Whether a valid state inside the room is needed to drive; false on a bench only, where the craft
  /// is fastened.
  bool require_state = true;
  bool require_lift = true;   ///< whether thrust is refused while the lift is off

  std::string validate() const;  ///< what is wrong; empty when nothing is
};

/// The ground's end of the link to the craft: who the craft is, and whether it may move.
///
/// DISARMED sends zero packets; ARMED sends commands, each at once and again at the keepalive rate;
/// FAULT sends zero packets and stays until disarmed by hand. ARMED is entered only with a known
/// craft, a fresh valid state and a fresh zero command of a single controller, and left for FAULT
/// as soon as commands are stale or packets cannot be sent, and when the state is stale or invalid
/// for recovery_time; until then zero packets go out, and the commands again when it is back. A
/// craft that counts the commands that reach it is a fault when its count stands still.
///
/// A silence shows whether the craft stops by itself: while ARMED no packet goes out for a bounded
/// time, then the link is DISARMED. Whatever ends the silence early (a fault, disarm, stop) sends
/// zeros at once; commands that arrive meanwhile are never sent. All times
/// are those of one steady clock [s]; the caller supplies them, and serialises the calls.
class GroundLink {
 public:
  enum class State { kDisarmed, kArmed, kFault };
  static constexpr double kLongestSilence = 2.0;    ///< [s]
  static constexpr double kMostSilentThrust = 0.5;  ///< input with which a silence may begin, 0..1
  struct Counters {
    std::uint64_t sent = 0, received = 0, malformed = 0, foreign = 0, refused = 0;
  };
  /// Sends a datagram; says what went wrong, nothing when nothing did.
  using Send = std::function<std::string(const std::string& datagram, const UdpAddress& to)>;

  /// `peer`: the craft's address where it is fixed (port 0: whichever it speaks from), nobody when
  /// it is learned from the first datagram. Throws std::invalid_argument when params are bad.
  GroundLink(const GroundLinkParams& params, const UdpAddress& peer, Send send);

  /// Throws std::invalid_argument, and keeps the old ones, when they are bad.
  void setParams(const GroundLinkParams& params);
  /// How many nodes publish commands, whether or not they do so now; more than one bars arming.
  void setPublishers(std::size_t count) { publishers_ = count; }

  /// A datagram came in; gives the craft's telemetry when it is that.
  std::optional<CraftTelemetry> datagram(double now, const std::string& data,
                                         const UdpAddress& from);
  /// A command of the controller named `source`, issued `age` seconds ago; negative: its stamp is
  /// from the future. Refused, and counted, when it is not finite, too old, more than a second
  /// ahead, or, while armed, of anyone but the controller that the link was armed with.
  void command(double now, double age, const std::string& source, const MotorCommand& command);
  /// A state measured `age` seconds ago (stale when that is more than a second in the future);
  /// `problem` says why it is invalid.
  void state(double now, double age, bool valid, const std::string& problem = "");
  /// The clock by which ages are measured was set: what came before is no longer fresh, and a craft
  /// that is driven gets zeros (FAULT). `what` describes the jump.
  void timeJumped(double now, const std::string& what);
  /// The craft does not do as it is told; `how` that is seen. A fault while armed.
  void disobeyed(double now, const std::string& how);
  /// With every state: why the craft does not stay in the room, empty when it does. A fault while
  /// armed, and bars arming.
  void confine(double now, const std::string& problem);
  /// Arms; otherwise says why not. `remark` follows the reason of the state while it is armed.
  std::string arm(double now, const std::string& remark = "");
  /// Repeats the present command once, then sends nothing for `duration` seconds (at most
  /// kLongestSilence), then disarms. Otherwise says why not.
  std::string silence(double now, double duration);
  void disarm(double now, const std::string& reason);
  /// Disarms for good: from now on nothing but zero packets is sent.
  void stop(double now, const std::string& reason);
  /// Watches the timeouts and keeps packets going out; to be called at least at the keepalive rate.
  void tick(double now);
  /// Sends one zero packet to the craft, if it is known.
  void sendZero(double now);

  State current() const { return state_; }
  /// Lift that the craft is told to have, 0..1; a loss of the state that zero packets bridge does
  /// not count.
  double lift() const {
    if (state_ != State::kArmed) return 0.0;
    return silent_until_ ? sent_.lift : command_.lift;
  }
  const std::string& reason() const { return reason_; }
  /// The craft's address; port 0 while it is not known.
  const UdpAddress& peer() const { return peer_; }
  const Counters& counters() const { return counters_; }
  /// Why a command was refused last; empty when none was.
  const std::string& refusal() const { return refusal_; }
  /// Why packets cannot be sent; empty when they can.
  const std::string& sendProblem() const { return send_problem_; }
  /// The command of the last packet.
  const MotorCommand& sent() const { return sent_; }
  /// When the next packet is due [s].
  double nextPacket() const { return next_packet_; }
  /// Grows with every change of state, reason or craft.
  std::uint64_t revision() const { return revision_; }

 private:
  bool isCraft(double now, const UdpAddress& from, bool telemetry);
  void refuse(const std::string& why, bool of_controller);
  void watch(double now);
  std::string stateProblem(double now) const;
  std::string craftMissing(double now) const;
  std::string stateMissing(double now) const;
  std::string commandMissing(double now) const;
  void watchState(double now);
  bool craftSilent(double now) const;
  bool deaf() const;
  void enter(State state, const std::string& reason);
  void fault(double now, const std::string& reason);
  void transmit(double now);
  void sendPacket(double now, const MotorCommand& command);

  GroundLinkParams params_;
  Send send_;
  UdpAddress fixed_;  ///< what the caller says of the craft's address
  UdpAddress peer_;
  bool peer_speaks_ = false;  ///< has sent a DroneState
  bool peer_locked_ = false;  ///< is the craft for certain: speaks, or was armed
  double peer_heard_;         ///< last datagram of the craft
  std::optional<std::uint32_t> peer_count_;  ///< of commands, by the craft; when it counts them
  double peer_counted_;                      ///< when that changed, or the craft was armed
  std::size_t publishers_ = 0;
  State state_ = State::kDisarmed;
  bool stopped_ = false;
  std::string reason_ = "not armed yet";
  MotorCommand sent_;
  MotorCommand command_;  ///< last one that was not refused
  std::string command_source_, armed_source_;
  std::string armed_reason_;
  std::optional<double> silent_until_;  ///< end of the silence; set only while armed
  std::string command_problem_;  ///< why the controller's newest command is not command_
  double command_until_;         ///< when command_ becomes stale
  double clash_until_;           ///< when a second controller may be taken to have gone
  std::string clash_;
  double state_until_;  ///< when the state becomes stale
  double lost_since_;   ///< when the state was lost while armed; never when it is there
  bool state_valid_ = false;
  std::string state_problem_;
  std::string room_problem_;
  std::string refusal_;
  std::string send_problem_;
  double sent_until_;  ///< when failing to send becomes a fault
  double next_packet_;
  std::uint64_t revision_ = 0;
  Counters counters_;
};

}  // namespace ground
