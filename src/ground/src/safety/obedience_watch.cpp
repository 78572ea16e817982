#include "ground/safety/obedience_watch.h"

#include "ground/model/plausibility.h"

namespace ground {

ObedienceWatch::ObedienceWatch(const Model& model)
    : input_max_(model.body.input_max), nominal_volts_(model.body.volts), monitor_(model) {}

void ObedienceWatch::sent(double time, bool armed, const Inputs& inputs, const DriveClock& drive) {
  if (!armed) {
    sent_.reset();
    return;
  }
  const bool begins = !sent_;
  if (begins) {
    monitor_.setDrive(drive);
    monitor_.reset();
  }
  if (begins || inputs != *sent_)
    monitor_.command(time, input_max_ * asVector(inputs.thrusters), inputs.lift);
  sent_ = inputs;
}

std::string ObedienceWatch::measured(double time, const RigidState<double>& state,
                                     const Vector3<double>& nu_variance) {
  if (timeout_ == 0 || !sent_ || !nu_variance.allFinite()) return "";
  monitor_.measure(time, state, nu_variance);
  return monitor_.disobedience(timeout_);
}

void ObedienceWatch::voltage(double volts) {
  if (isPlausibleVoltage(volts, nominal_volts_)) monitor_.voltage(volts);
}

}  // namespace ground
