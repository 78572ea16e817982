#include "ground/safety/ground_link.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>

namespace ground {
namespace {

constexpr double kPeerTimeout = 2;    // silence after which a craft may return on another port [s]
constexpr double kSendTimeout = 0.2;  // longest failure to send while armed [s]
constexpr double kNever = -std::numeric_limits<double>::infinity();

/// The largest input of a thruster that pushes; angles do not.
double pushing(const Thrusters<double>& inputs, const ThrusterLayout& layout) {
  double most = 0;
  for (int i = 0; i < inputs.size(); ++i)
    if (layout.pushes(i)) most = std::max(most, std::abs(inputs(i)));
  return most;
}

/// Whether a thruster pushes without lift. An input of the wrong sign for the thruster is clipped.
bool thrustAlone(const MotorCommand& c, const ThrusterLayout& layout) {
  return pushing(layout.clipped(c.thrusters), layout) > 0 && !(c.lift > 0);
}

std::string because(const std::string& what, const std::string& why) {
  return why.empty() ? what : what + ": " + why;
}

void check(const GroundLinkParams& params) {
  const std::string wrong = params.validate();
  if (!wrong.empty()) throw std::invalid_argument(wrong);
}

}  // namespace

GroundLink::GroundLink(const GroundLinkParams& params, const UdpAddress& peer, Send send,
                       ThrusterLayoutPtr layout)
    : params_(params),
      send_(std::move(send)),
      layout_(std::move(layout)),
      fixed_(peer),
      peer_(peer),
      peer_heard_(kNever),
      peer_counted_(kNever),
      clash_until_(kNever),
      lost_since_(kNever),
      sent_until_(kNever),
      next_packet_(kNever) {
  sent_ = command_ = Inputs::off(layout_->size());
  check(params);
}

void GroundLink::setParams(const GroundLinkParams& params) {
  check(params);
  next_packet_ += 1 / params.keepalive_rate - 1 / params_.keepalive_rate;
  params_ = params;
}

bool GroundLink::isCraft(double now, const UdpAddress& from, bool telemetry) {
  if (from == peer_) return true;
  if (state_ == State::kArmed || fixed_.port != 0) return false;
  if (fixed_.known() && from.host != fixed_.host) return false;
  const bool unknown = peer_.port == 0;
  // Any first datagram counts as the craft's, so it may have been a stray one. Until the craft is
  // certain, a sender of telemetry replaces it.
  const bool better = !peer_locked_ && telemetry;
  // A restarted craft sends from another port of its address. Silence is only known of a craft that
  // has sent telemetry.
  const bool back = peer_speaks_ && telemetry && from.host == peer_.host && now - peer_heard_ > kPeerTimeout;
  if (!unknown && !better && !back) return false;
  peer_ = from;
  peer_count_ = peer_boot_ = std::nullopt;
  peer_fell_ = false;
  ++revision_;
  return true;
}

bool GroundLink::datagram(double now, const std::optional<CraftTelemetry>& telemetry,
                          const UdpAddress& from) {
  if (!telemetry) ++counters_.malformed;
  if (!isCraft(now, from, telemetry.has_value())) {
    ++counters_.foreign;
    return false;
  }
  peer_heard_ = now;
  if (!telemetry) return false;
  peer_speaks_ = peer_locked_ = true;
  ++counters_.received;
  if (restarted(now, *telemetry) && state_ == State::kArmed) fault(now, "the craft has restarted");
  return true;
}

/// Whether telemetry of the craft shows that it has restarted. UDP repeats datagrams and delivers some late,
/// so a single lower count shows nothing.
bool GroundLink::restarted(double now, const CraftTelemetry& telemetry) {
  const bool booted = telemetry.boot && peer_boot_ && telemetry.boot != peer_boot_;
  if (telemetry.boot) peer_boot_ = telemetry.boot;
  if (booted) peer_count_.reset();
  if (!telemetry.commands) return booted;
  const bool lower = telemetry.commands < peer_count_, again = lower && peer_fell_;
  peer_fell_ = lower && !again;
  if (peer_fell_) return booted;
  if (telemetry.commands != peer_count_) peer_counted_ = now;
  peer_count_ = telemetry.commands;
  return booted || again;
}

void GroundLink::command(double now, double age, const std::string& source, const MotorCommand& command) {
  watch(now);  // a command after the timeout must not prevent the fault
  const std::string why = objection(age, source, command);
  if (!why.empty()) return refuseCommand(now, source, why);
  if (source != command_source_ && !commandsStale(now)) {
    clash_until_ = now + params_.command_timeout;
    clash_ = "both " + command_source_ + " and " + source + " send commands: end one (controller:=none)";
  }
  command_ = command;
  command_source_ = source;
  command_problem_.clear();
  commands_.received({now, now}, now - age);
  if (state_ == State::kArmed) transmit(now);
}

/// Why a command is not accepted; empty if it is.
std::string GroundLink::objection(double age, const std::string& source, const MotorCommand& command) const {
  const bool armed = state_ == State::kArmed;
  if (armed && source != armed_source_)
    return "is not of " + armed_source_ + ", with which the craft is armed";
  if (!command.finite()) return "is not finite";
  if (command.thrusters.size() != layout_->size())
    return "is for " + std::to_string(command.thrusters.size()) + " thrusters, and the craft has " +
           std::to_string(layout_->size());
  if (armed && params_.require_lift && thrustAlone(command, *layout_)) return "is thrust without lift";
  if (!(age < params_.command_timeout)) return "is older by its stamp than command_timeout";
  return age < -Freshness::kMaxAhead ? "has a stamp from the future: the clocks differ" : "";
}

void GroundLink::refuseCommand(double now, const std::string& source, const std::string& why) {
  watch(now);
  ++counters_.refused;
  refusal_ = "a command of " + source + " " + why;
  if (state_ == State::kArmed && source != armed_source_) return;
  command_problem_ = refusal_;
  // A refused command is not a zero command, so it prevents arming. While armed, the last accepted
  // command becomes stale instead.
  if (state_ != State::kArmed) commands_.reset();
}

void GroundLink::state(double now, double age, bool valid, const std::string& problem) {
  watch(now);
  loss_.received({now, now}, now - age, valid, problem);
  watch(now);
}

void GroundLink::timeJumped(double now, const std::string& what) {
  watch(now);
  commands_.reset();
  loss_.reset();
  if (state_ == State::kArmed) fault(now, what);
}

void GroundLink::disobeyed(double now, const std::string& how) {
  // No commands are sent during a silence.
  if (state_ == State::kArmed && !silent_until_)
    fault(now, because("the craft does not follow its commands", how));
}

void GroundLink::confine(double now, const std::string& problem) {
  room_problem_ = problem;
  if (state_ == State::kArmed && !problem.empty()) fault(now, problem);
}

std::string GroundLink::arm(double now, const std::string& remark) {
  watch(now);
  if (stopped_) return reason_;
  if (silent_until_) return reason_;
  if (state_ == State::kArmed) return "";
  if (state_ == State::kFault) return "in fault (" + reason_ + "): disarm first";
  for (const std::string& missing : {craftMissing(now), stateMissing(now), commandMissing(now)})
    if (!missing.empty()) return missing;
  armed_source_ = command_source_;
  peer_locked_ = true;
  lost_since_ = kNever;
  peer_counted_ = now;
  armed_reason_ = "armed with commands of " + armed_source_;
  if (!remark.empty()) armed_reason_ += "; " + remark;
  enter(State::kArmed, armed_reason_);
  return "";
}

/// Why the craft does not allow arming; empty if it does.
std::string GroundLink::craftMissing(double now) const {
  if (peer_.port == 0) return "no craft is connected";
  if (!send_problem_.empty()) return because("packets cannot be sent", send_problem_);
  if (craftSilent(now)) return "the craft has fallen silent (craft_timeout)";
  return "";
}

/// Why the state does not allow arming; empty if it does.
std::string GroundLink::stateMissing(double now) const {
  if (!params_.require_state) return "";
  const std::string lost = stateLoss(now);
  return lost.empty() ? room_problem_ : lost;
}

/// Why the commands do not allow arming; empty if they do.
std::string GroundLink::commandMissing(double now) const {
  if (clash_until_ > now) return clash_;
  if (commandsStale(now)) return because("there is no fresh command", command_problem_);
  if (!command_.zero()) return "the command is not zero";
  return "";
}

std::string GroundLink::silence(double now, double duration) {
  watch(now);
  if (state_ != State::kArmed) return because("not armed", reason_);
  if (silent_until_ || lost_since_ != kNever) return reason_;
  if (!(duration > 0 && duration <= kLongestSilence))
    return "a silence must be longer than 0 s and at most 2 s";
  if (pushing(command_.thrusters, *layout_) > kMaxSilentThrust)
    return "the thrust is above 0.5, too much for a craft that may not stop";
  transmit(now);  // so that the silence begins with a packet at a known time
  if (!send_problem_.empty()) return because("packets cannot be sent", send_problem_);
  silent_until_ = now + duration;
  enter(State::kArmed, "silent: nothing is sent, to see whether the craft stops by itself");
  return "";
}

void GroundLink::disarm(double now, const std::string& reason) {
  if (!stopped_) enter(State::kDisarmed, reason);
  transmit(now);
}

void GroundLink::stop(double now, const std::string& reason) {
  disarm(now, reason);
  stopped_ = true;
}

void GroundLink::tick(double now) {
  watch(now);
  if (next_packet_ <= now) transmit(now);
}

void GroundLink::watch(double now) {
  if (state_ != State::kArmed) return;
  if (silent_until_ && *silent_until_ <= now) return disarm(now, "disarmed after the silence");
  if (commandsStale(now)) return fault(now, because("commands are stale", command_problem_));
  // It may have restarted, and must not receive thrust when it returns.
  if (craftSilent(now)) return fault(now, "the craft has fallen silent (craft_timeout)");
  if (receivesNoCommands()) return disobeyed(now, "its count of received commands has stopped");
  if (!send_problem_.empty() && sent_until_ <= now)
    return fault(now, because("packets cannot be sent", send_problem_));
  watchState(now);
}

/// Cuts the thrust while the state is lost, for at most recovery_time. The lift stays as commanded: a skirt
/// without air would have to be filled again before the next thrust.
void GroundLink::watchState(double now) {
  const std::string lost = params_.require_state ? stateLoss(now) : "";
  if (!lost.empty() && lost_since_ == kNever) {
    if (params_.recovery_time == 0 || silent_until_) return fault(now, lost);
    lost_since_ = now;
    enter(State::kArmed, "no thrust until the state is back: " + lost);
    transmit(now);
  } else if (lost.empty() && lost_since_ != kNever) {
    lost_since_ = kNever;
    enter(State::kArmed, armed_reason_);
  } else if (!lost.empty() && now - lost_since_ >= params_.recovery_time) {
    fault(now, lost);
  }
}

/// Whether a craft that has sent telemetry is silent for too long. Others may always be silent.
bool GroundLink::craftSilent(double now) const {
  return peer_speaks_ && params_.craft_timeout > 0 && now - peer_heard_ > params_.craft_timeout;
}

/// Whether the craft's own count shows that it receives no commands. Not during a silence, in which
/// none are sent.
bool GroundLink::receivesNoCommands() const {
  return !silent_until_ && peer_count_ && params_.obedience_timeout > 0 &&
         peer_heard_ - peer_counted_ > params_.obedience_timeout;
}

void GroundLink::fault(double now, const std::string& reason) {
  enter(State::kFault, reason);
  transmit(now);
}

void GroundLink::enter(State state, const std::string& reason) {
  state_ = state;
  if (state != State::kArmed) silent_until_.reset();
  reason_ = reason;
  ++revision_;
}

void GroundLink::transmit(double now) {
  next_packet_ = now + 1 / params_.keepalive_rate;
  if (silent_until_) return;
  MotorCommand command = MotorCommand::off(layout_->size());
  if (state_ == State::kArmed) command.lift = command_.lift;
  const bool obeys = state_ == State::kArmed && lost_since_ == kNever;
  sendPacket(now, obeys ? command_ : command);
}

void GroundLink::sendZero(double now) { sendPacket(now, MotorCommand::off(layout_->size())); }

void GroundLink::sendPacket(double now, const MotorCommand& command) {
  if (peer_.port == 0) return;
  const std::string problem = send_(command, peer_);
  sent_ = command;
  if (problem.empty()) {
    ++counters_.sent;
  } else if (send_problem_.empty()) {
    sent_until_ = now + kSendTimeout;
  }
  send_problem_ = problem;
}

}  // namespace ground
