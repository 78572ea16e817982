#include "ground/model/thrust_acceleration.h"

#include "ground/model/plausibility.h"

namespace ground {

ThrustAcceleration::ThrustAcceleration(const Model& model)
    : thrusters_(model.thrusters),
      input_max_(model.body.input_max),
      push_(model.body.k / model.body.m),
      nominal_volts_(model.body.volts),
      craft_(model) {}

void ThrustAcceleration::setVoltage(double volts) {
  if (isPlausibleVoltage(volts, nominal_volts_)) volts_ = volts;
}

Vector2<double> ThrustAcceleration::operator()(double t, const Inputs& inputs) const {
  const Thrusters<double> thrusters =
      thrusters_->clipped(Thrusters<double>(input_max_ * asVector(inputs.thrusters)), input_max_);
  const RigidState<double> rest{Vector3<double>::Zero(), Vector3<double>::Zero()};
  const auto by = [&](const Thrusters<double>& some) -> Vector2<double> {
    return craft_.derivative(t, rest, some, {inputs.lift, volts_}).nu.head<2>();
  };
  const Vector2<double> plain = push_ * thrusters_->atRest(thrusters).head<2>();
  const Vector2<double> whole = by(thrusters) - by(Thrusters<double>::zero(thrusters.size()));
  return whole.allFinite() && whole.norm() > plain.norm() ? whole : plain;
}

}  // namespace ground
