#include "ground/control/reference_pilot.h"

#include <algorithm>
#include <ctime>
#include <utility>

#include "ground/model/plausibility.h"

namespace ground {
namespace {

/// CPU time of this thread [s], without that of other threads and processes.
double processorTime() {
  timespec time;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

}  // namespace

ReferencePilot::ReferencePilot(Clock clock, Decided decided, Clock steady)
    : clock_(std::move(clock)), steady_(std::move(steady)), decided_(std::move(decided)) {
  given_.reserve(kGiven);
}

void ReferencePilot::setCraft(const Model& model) {
  input_max_ = model.body.input_max;
  nominal_volts_ = model.body.volts;
  acceleration_.emplace(model);
  if (volts_) acceleration_->setVoltage(*volts_);
  thrusters_ = model.thrusters;
}

void ReferencePilot::swapController(std::unique_ptr<TrackingController>& controller, const Model& model) {
  controller_.swap(controller);
  controller_->setClock(steady_);
  setCraft(model);
  for (const auto& [time, inputs] : given_)
    controller_->commanded(time, input_max_ * asVector(inputs.thrusters), inputs.lift);
  obedience_.reset();
  if (!expects_obedience_) return;
  obedience_.emplace(model);
  obedience_->setDrive(drive_);
  if (volts_) obedience_->voltage(*volts_);
}

void ReferencePilot::swapReference(ReferencePtr& reference) {
  reference_.swap(reference);
  reference_start_.reset();
}

void ReferencePilot::voltage(double volts) {
  if (!isPlausibleVoltage(volts, nominal_volts_)) return;
  volts_ = volts;
  if (acceleration_) acceleration_->setVoltage(volts);
  if (obedience_) obedience_->voltage(volts);
}

void ReferencePilot::driveBegan(double began, double as_of) {
  drive_.record(began, as_of);
  if (obedience_) obedience_->setDrive(drive_);
}

void ReferencePilot::commanded(double time, const Inputs& inputs) {
  drive_.command(time, inputs.lift);
  if (given_.size() == kGiven) given_.erase(given_.begin());
  given_.emplace_back(time, inputs);
  const Thrusters<double> thrusters = input_max_ * asVector(inputs.thrusters);
  if (controller_) controller_->commanded(time, thrusters, inputs.lift);
  if (obedience_) obedience_->command(time, thrusters, inputs.lift);
}

void ReferencePilot::activate(double) {
  reference_start_.reset();
  controller_->reset();
  if (!obedience_) return;
  obedience_->setDrive(drive_);
  obedience_->reset();
}

void ReferencePilot::observe(const MeasuredState& measured) {
  pose_ = measured.pose;
  controller_->observe(observation(measured.stamp, measured.state, lift_));
}

std::string ReferencePilot::objection(const MeasuredState& measured) {
  const double stamp = measured.stamp;
  observe(measured);
  const std::string objection = controller_->objection();
  if (!objection.empty()) return objection;
  if (!reference_start_) {
    reference_start_ = stamp;
    watch_.restart();
  }
  if (obedience_) {
    obedience_->measure(stamp, measured.state, measured.nu_variance);
    const std::string instead = obedience_->disobedience(kDisobedient);
    if (!instead.empty()) return "the craft does not follow its commands: " + instead;
  }
  const double error = (controller_->position(measured.state) - at(stamp).p).norm();
  return watch_.look(std::max(0.0, stamp - *reference_start_), error);
}

Inputs ReferencePilot::update(double, double stamp, const RigidState<double>& state, double lift) {
  const double before = processorTime();
  lift_ = lift;
  const Observation seen = observation(stamp, state, lift);
  const double now = seen.now;
  Thrusters<double> inputs = controller_->decide(seen);
  asVector(inputs) /= input_max_;
  Thrusters<double> wanted = controller_->wanted();
  asVector(wanted) /= input_max_;
  decided_({now, stamp, at(stamp), inputs, wanted, processorTime() - before});
  return {inputs, lift};
}

Observation ReferencePilot::observation(double stamp, const RigidState<double>& state, double lift) const {
  const double now = std::max(stamp, clock_());
  return {now,
          stamp,
          state,
          reference_.get(),
          reference_start_.value_or(stamp),
          {lift, volts_},
          drive_.origin(now),
          pose_};
}

ReferencePoint ReferencePilot::at(double stamp) const {
  return reference_->at(std::max(0.0, stamp - *reference_start_));
}

}  // namespace ground
