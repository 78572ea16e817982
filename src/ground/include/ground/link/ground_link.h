#pragma once

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
  double keepalive_rate = 50.0;  ///< packets per second when nothing new comes [Hz]
  double peer_timeout = 2.0;     ///< silence after which a craft may come back on another port [s]
  bool require_state = true;     ///< whether a valid state is needed to drive

  std::string validate() const;  ///< what is wrong; empty when nothing is
};

/// The ground's end of the link to the craft: who the craft is, and whether it may move.
///
/// DISARMED sends zero packets; ARMED sends commands, each at once and again at the keepalive rate;
/// FAULT sends zero packets and stays until disarmed by hand. ARMED is entered only with a known
/// craft, a fresh valid state and a fresh zero command, and left for FAULT as soon as commands or
/// state are stale. All times are those of one steady clock [s]; the caller supplies them, and
/// serialises the calls.
class GroundLink {
 public:
  enum class State { kDisarmed, kArmed, kFault };
  struct Counters {
    std::uint64_t sent = 0, received = 0, malformed = 0, foreign = 0, refused = 0;
  };
  using Send = std::function<bool(const std::string& datagram, const UdpAddress& to)>;

  /// `peer`: the craft's address where it is fixed (port 0: whichever it speaks from), nobody when
  /// it is learned from the first datagram.
  GroundLink(const GroundLinkParams& params, const UdpAddress& peer, Send send);

  void setParams(const GroundLinkParams& params) { params_ = params; }

  /// A datagram came in; gives the craft's telemetry when it is that.
  std::optional<CraftTelemetry> datagram(double now, const std::string& data,
                                         const UdpAddress& from);
  /// A command of the controller named `source`, issued `age` seconds ago. While armed, commands of
  /// anyone but the controller that it was armed with are refused.
  void command(double now, double age, const std::string& source, const MotorCommand& command);
  /// A state measured `age` seconds ago.
  void state(double now, double age, bool valid);
  /// Arms; otherwise says why not.
  std::string arm(double now);
  void disarm(double now, const std::string& reason);
  /// Watches the timeouts and keeps packets going out; to be called at least at the keepalive rate.
  void tick(double now);
  /// Sends one zero packet to the craft, if it is known.
  void sendZero();

  State current() const { return state_; }
  const std::string& reason() const { return reason_; }
  const UdpAddress& peer() const { return peer_; }
  const Counters& counters() const { return counters_; }

 private:
  bool isCraft(double now, const UdpAddress& from, bool telemetry);
  void enter(State state, const std::string& reason);
  void transmit(double now);

  GroundLinkParams params_;
  Send send_;
  UdpAddress peer_;
  bool peer_fixed_;
  bool peer_confirmed_;  ///< has sent a DroneState, or is fixed
  double peer_heard_;    ///< last datagram of the craft
  State state_ = State::kDisarmed;
  std::string reason_ = "not armed yet";
  MotorCommand command_;  ///< last finite one
  std::string command_source_, armed_source_;
  double command_until_;  ///< when command_ becomes stale
  double state_until_;    ///< when the state becomes stale
  bool state_valid_ = false;
  double next_packet_;
  Counters counters_;
};

}  // namespace ground
