#include "ground/safety/sender_gate.h"

#include <utility>

namespace ground {

SenderGate::SenderGate(const GroundLinkParams& params, const UdpAddress& peer, GroundLink::Send send,
                       ThrusterLayoutPtr layout)
    : send_(std::move(send)),
      link_(
          params, peer,
          [this](const MotorCommand& command, const UdpAddress& to) { return this->send(command, to); },
          std::move(layout)) {}

void SenderGate::setCraft(const Model& model) {
  acceleration_.emplace(model);
  obedience_.emplace(model);
  setParams(link_.params());
}

void SenderGate::setParams(const GroundLinkParams& params) {
  link_.setParams(params);
  if (obedience_) obedience_->setTimeout(params.require_state ? params.obedience_timeout : 0);
}

void SenderGate::command(Instant now, double stamp, const std::string& source, const MotorCommand& command) {
  now_ = now;
  confine();  // before thrust is sent
  link_.command(now.steady, now.time - stamp, source, command);
}

void SenderGate::state(Instant now, const MeasuredState& measured) {
  now_ = now;
  const bool finite = measured.finite(), valid = measured.valid && finite;
  link_.state(now.steady, now.time - measured.stamp, valid,
              measured.valid && !finite ? "the state is not finite" : measured.problem);
  guard_.state(now.time, measured);
  confine();
  if (!valid || !obedience_) return;
  const std::string instead =
      obedience_->measured(local(measured.stamp), measured.state, measured.nu_variance);
  if (!instead.empty()) link_.disobeyed(now.steady, instead);
}

void SenderGate::voltage(double volts) {
  if (acceleration_) acceleration_->setVoltage(volts);
  if (obedience_) obedience_->voltage(volts);
}

void SenderGate::timeJumped(Instant now, const std::string& what) {
  now_ = now;
  guard_.reset();
  link_.timeJumped(now.steady, what);
}

std::string SenderGate::silence(Instant now, double duration) {
  now_ = now;
  confine();  // a last command is sent
  return link_.silence(now.steady, duration);
}

void SenderGate::tick(Instant now) {
  now_ = now;
  if (armed()) confine();  // the craft moves on unseen
  link_.tick(now.steady);
}

/// Sends a command, and stores it for the fence and for the watch.
std::string SenderGate::send(const MotorCommand& command, const UdpAddress& to) {
  if (!epoch_) epoch_ = now_.time;
  const double time = local(now_.time);
  drive_.command(time, link_.lift());
  const std::string problem = send_(command, to);
  if (problem.empty()) {
    const double t = drive_.since(time);
    guard_.sent(now_.time, acceleration_ ? (*acceleration_)(t, command) : Vector2<double>(0, 0));
  }
  if (obedience_) obedience_->sent(time, armed(), command, drive_);
  return problem;
}

}  // namespace ground
