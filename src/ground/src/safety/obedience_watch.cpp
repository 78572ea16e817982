#include "ground/safety/obedience_watch.h"

#include <utility>

#include "ground/model/plausibility.h"

namespace ground {

ObedienceWatch::ObedienceWatch(const Model& model)
    : craft_(model),
      input_max_(model.body.input_max),
      nominal_volts_(model.body.volts),
      monitor_(std::make_unique<ObedienceMonitor>(model)),
      told_(Eigen::VectorXd::Zero(craft_.size())) {}

void ObedienceWatch::setParams(double timeout, bool adapts) {
  timeout_ = timeout;
  adapts_ = adapts;
  applyPatience();
}

void ObedienceWatch::sent(double time, bool armed, const Inputs& inputs) {
  if (!armed) {
    if (usual_) {
      monitor_ = std::move(usual_);
      told_.setZero();
      applyPatience();
    }
    sent_.reset();
    return;
  }
  const bool begins = !sent_;
  if (begins) {
    monitor_->reset();
    began_ = time;
  }
  if (begins || inputs != *sent_)
    monitor_->command(time - began_, input_max_ * asVector(inputs.thrusters), inputs.lift);
  sent_ = inputs;
}

std::string ObedienceWatch::measured(double time, const RigidState<double>& state,
                                     const Vector3<double>& nu_variance) {
  if (timeout_ == 0 || !sent_ || !nu_variance.allFinite()) return "";
  monitor_->measure(time - began_, state, nu_variance);
  return monitor_->disobedience(timeout_);
}

void ObedienceWatch::voltage(double volts) {
  if (!isPlausibleVoltage(volts, nominal_volts_)) return;
  volts_ = volts;
  monitor_->voltage(volts);
  if (usual_) usual_->voltage(volts);
}

std::string ObedienceWatch::told(const Eigen::VectorXd& change) {
  if (!adapts_ || !sent_ || change.size() != craft_.size()) return "";
  const Eigen::VectorXd dead = craft_.deadOnly(craft_.bounded(change));
  if (craft_.dead(dead).size() <= craft_.dead(told_).size()) return "";
  auto monitor = std::make_unique<ObedienceMonitor>(craft_.apply(dead));
  if (volts_) monitor->voltage(*volts_);
  monitor_.swap(monitor);
  if (!usual_) usual_ = std::move(monitor);
  applyPatience();
  told_ = dead;
  sent_.reset();  // begins with the next command, which is repeated
  return craft_.deadNames(dead);
}

}  // namespace ground
