#pragma once

#include <optional>
#include <string>

#include "ground/model/drive_clock.h"
#include "ground/model/model.h"
#include "ground/model/thrust_acceleration.h"
#include "ground/safety/fence_guard.h"
#include "ground/safety/ground_link.h"
#include "ground/safety/obedience_watch.h"

namespace ground {

/// Stands between the controllers and the craft: a GroundLink, the FenceGuard of what has left for the craft,
/// and the ObedienceWatch of its motion. The sender and the experiments in lockstep have the same one.
///
///     SenderGate gate(params, craft_address, send, model.thrusters);
///     gate.setCraft(model);
///     gate.setFence(Fence(room, 0));
///     gate.state(now, measured);             // every state
///     gate.command(now, stamp, name, inputs);  // every command, of any controller
///     gate.link(now).arm(now.steady);
///     gate.tick(now);                        // at least at the keepalive rate
///
/// Without setCraft() the fence counts no thrust, and a craft may disobey. It reads no clock, and the caller
/// serialises the calls. Only the gate may pass states, commands and jumps of time to its link.
class SenderGate {
 public:
  /// Parameters, address of the craft, and function that sends a packet: see GroundLink.
  SenderGate(const GroundLinkParams& params, const UdpAddress& peer, GroundLink::Send send,
             ThrusterLayoutPtr layout);
  SenderGate(const SenderGate&) = delete;
  SenderGate& operator=(const SenderGate&) = delete;

  void setCraft(const Model& model);
  void setFence(const Fence& fence) { guard_.setFence(fence); }
  /// See GroundLink. Without `require_state` the craft is fastened, and does not have to follow its commands.
  void setParams(const GroundLinkParams& params);

  /// Call with every command. `stamp`: time at which it was issued, clock of stamps [s].
  void command(Instant now, double stamp, const std::string& source, const MotorCommand& command);
  /// Call with every state.
  void state(Instant now, const MeasuredState& measured);
  /// Call when the craft reports the voltage of its battery [V].
  void voltage(double volts);
  /// Call when the clock of stamps was set.
  void timeJumped(Instant now, const std::string& what);
  /// See GroundLink.
  std::string silence(Instant now, double duration);
  void tick(Instant now);

  /// For everything else that is asked of the link now.
  GroundLink& link(Instant now) {
    now_ = now;
    return link_;
  }
  const GroundLink& link() const { return link_; }
  /// When drives began, by the lift that was commanded while armed, on a clock that begins at epoch().
  const DriveClock& drive() const { return drive_; }
  /// When the first packet was sent, clock of stamps [s].
  double epoch() const { return epoch_.value_or(0); }
  bool armed() const { return link_.current() == GroundLink::State::kArmed; }

 private:
  std::string send(const MotorCommand& command, const UdpAddress& to);
  /// A time, clock of stamps [s], as a small number.
  double local(double time) const { return time - epoch(); }
  void confine() { link_.confine(now_.steady, guard_.objection(now_.time)); }

  GroundLink::Send send_;
  GroundLink link_;
  FenceGuard guard_;
  std::optional<ThrustAcceleration> acceleration_;  ///< no value without a model
  std::optional<ObedienceWatch> obedience_;         ///< no value without a model
  DriveClock drive_;
  std::optional<double> epoch_;
  Instant now_{0, 0};  ///< of the last call
};

}  // namespace ground
