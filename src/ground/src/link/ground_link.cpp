#include "ground/link/ground_link.h"

#include <cmath>
#include <limits>

namespace ground {
namespace {

constexpr double kNever = -std::numeric_limits<double>::infinity();

bool finite(const MotorCommand& c) {
  return std::isfinite(c.left) && std::isfinite(c.right) && std::isfinite(c.lift);
}

bool zero(const MotorCommand& c) { return c.left <= 0 && c.right <= 0 && c.lift <= 0; }

}  // namespace

std::string GroundLinkParams::validate() const {
  if (!(command_timeout > 0)) return "command_timeout must be positive";
  if (!(state_timeout > 0)) return "state_timeout must be positive";
  if (!(keepalive_rate > 0)) return "keepalive_rate must be positive";
  if (!(peer_timeout > 0)) return "peer_timeout must be positive";
  return "";
}

GroundLink::GroundLink(const GroundLinkParams& params, const UdpAddress& peer, Send send)
    : params_(params),
      send_(std::move(send)),
      peer_(peer),
      peer_fixed_(peer.known()),
      peer_confirmed_(peer.known()),
      peer_heard_(kNever),
      command_until_(kNever),
      state_until_(kNever),
      next_packet_(kNever) {}

bool GroundLink::isCraft(double now, const UdpAddress& from, bool telemetry) {
  if (from == peer_) return true;
  if (peer_fixed_) {
    if (peer_.port != 0 || from.host != peer_.host) return false;
    peer_ = from;  // a fixed host speaks from this port
    return true;
  }
  const bool free = !peer_.known();
  // The craft's hello may be any datagram, so that a stray one may have been taken for it: as long
  // as the craft is not driven, whoever speaks its protocol is a better guess.
  const bool better = !peer_confirmed_ && telemetry && state_ != State::kArmed;
  // A craft that was restarted speaks from another port.
  const bool back = from.host == peer_.host && telemetry && state_ != State::kArmed &&
                    now - peer_heard_ > params_.peer_timeout;
  if (!free && !better && !back) return false;
  peer_ = from;
  return true;
}

std::optional<CraftTelemetry> GroundLink::datagram(double now, const std::string& data,
                                                   const UdpAddress& from) {
  CraftTelemetry telemetry;
  const bool understood = decodeTelemetry(data, telemetry);
  if (!understood) ++counters_.malformed;
  if (!isCraft(now, from, understood)) {
    ++counters_.foreign;
    return std::nullopt;
  }
  peer_heard_ = now;
  if (!understood) return std::nullopt;
  peer_confirmed_ = true;
  ++counters_.received;
  return telemetry;
}

void GroundLink::command(double now, double age, const std::string& source,
                         const MotorCommand& command) {
  const bool stranger = state_ == State::kArmed && source != armed_source_;
  if (!finite(command) || !std::isfinite(age) || stranger) {
    ++counters_.refused;
    return;
  }
  command_ = command;
  command_source_ = source;
  command_until_ = now - std::max(0.0, age) + params_.command_timeout;
  if (state_ == State::kArmed && command_until_ > now) transmit(now);
}

void GroundLink::state(double now, double age, bool valid) {
  state_valid_ = valid;
  state_until_ = std::isfinite(age) ? now - std::max(0.0, age) + params_.state_timeout : kNever;
  if (state_ == State::kArmed && params_.require_state && !valid) {
    enter(State::kFault, "the state is invalid");
    transmit(now);
  }
}

std::string GroundLink::arm(double now) {
  if (state_ == State::kArmed) return "";
  if (state_ == State::kFault) return "in fault (" + reason_ + "): disarm first";
  if (!peer_.known() || peer_.port == 0) return "no craft has been heard of";
  if (params_.require_state && !state_valid_) return "there is no valid state";
  if (params_.require_state && state_until_ <= now) return "the state is stale";
  if (command_until_ <= now) return "there is no fresh command";
  if (!zero(command_)) return "the command is not zero";
  armed_source_ = command_source_;
  enter(State::kArmed, "armed with commands of " + armed_source_);
  return "";
}

void GroundLink::disarm(double now, const std::string& reason) {
  enter(State::kDisarmed, reason);
  transmit(now);
}

void GroundLink::tick(double now) {
  if (state_ == State::kArmed) {
    if (command_until_ <= now) {
      enter(State::kFault, "commands are stale");
    } else if (params_.require_state && state_until_ <= now) {
      enter(State::kFault, "the state is stale");
    }
    if (state_ == State::kFault) transmit(now);
  }
  if (next_packet_ <= now) transmit(now);
}

void GroundLink::enter(State state, const std::string& reason) {
  state_ = state;
  reason_ = reason;
}

void GroundLink::transmit(double now) {
  if (state_ != State::kArmed) {
    sendZero();
  } else if (send_(encodeMotors(command_), peer_)) {
    ++counters_.sent;
  }
  next_packet_ = now + 1 / params_.keepalive_rate;
}

void GroundLink::sendZero() {
  if (peer_.known() && peer_.port != 0 && send_(encodeMotors(MotorCommand()), peer_))
    ++counters_.sent;
}

}  // namespace ground
