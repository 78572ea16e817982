#include "ground/control/excitation_pilot.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

namespace ground {

std::string ReturnParams::validate() const {
  if (!(burst >= 0.1 && burst <= 3600)) return "burst must be between 0.1 and 3600 s";
  return room.validate();
}

ExcitationPilot::ExcitationPilot(ReferencePilot::Clock clock, Marked marked, ReferencePilot::Decided decided,
                                 ReferencePilot::Clock steady)
    : clock_(clock),
      marked_(std::move(marked)),
      // Decisions during a burst only plan the way home and are not reported.
      home_(
          clock,
          [this, decided](const ReferencePilot::Decision& decision) {
            if (!bursting_) decided(decision);
          },
          std::move(steady)) {}

void ExcitationPilot::play(InputSignal signal, double duration, const Model* craft) {
  setNext({std::move(signal), duration, std::nullopt, craft ? std::make_optional(*craft) : std::nullopt});
}

void ExcitationPilot::playInside(InputSignal signal, double duration, const Model& model,
                                 const ReturnParams& params) {
  if (signal.thrusters->channels() != model.thrusters->channels())
    throw std::invalid_argument("the input is for thrusters " + signal.thrusters->names() +
                                ", and the model has " + model.thrusters->names());
  const std::string wrong = params.validate();
  if (!wrong.empty()) throw std::invalid_argument(wrong);
  setNext({std::move(signal), duration, params, model});
}

void ExcitationPilot::setNext(Program program) {
  next_ = std::move(program);
  if (!active_) takeNext();
}

void ExcitationPilot::takeNext() {
  signal_ = std::move(next_->signal);
  duration_ = next_->duration;
  returns_ = next_->returns;
  if (next_->model) home_.setCraft(*next_->model);
  if (returns_) {
    const Room& room = returns_->room;
    auto control = std::make_unique<PredictiveControl>(*next_->model, PredictiveParams());
    control->avoid({Fence(room, room.margin), Fence::kLoss});
    control_ = control.get();
    std::unique_ptr<TrackingController> controller = std::move(control);
    ReferencePtr reference = makePoint(room.home);
    home_.swapController(controller, *next_->model);
    home_.swapReference(reference);
    home_.setMaxError(std::numeric_limits<double>::infinity());
  }
  next_.reset();
}

void ExcitationPilot::activate(double stamp) {
  if (next_) takeNext();
  active_ = true;
  activated_ = stamp;
  number_ = 0;
  played_ = 0;
  ended_ = std::numeric_limits<double>::infinity();
  checked_ = -ended_;
  if (returns_) home_.activate(stamp);
  begin(true, "the first one");
}

std::string ExcitationPilot::objection(const MeasuredState& measured) {
  if (!returns_) return "";
  const double stamp = measured.stamp;
  const std::string reason = home_.objection(measured);
  if (!reason.empty() || !bursting_ || stamp < checked_ + kCheck) return reason;
  checked_ = stamp;
  home_.update(0, stamp, measured.state, lift_);  // only for the plan; the inputs are not used
  const double elapsed = clock_() - activated_;
  if (spare() < 0) {
    begin(false, "the way home would come close to a wall");
  } else if (elapsed - began_ >= returns_->burst) {
    begin(false, "the burst has lasted long enough");
  }
  return "";
}

Inputs ExcitationPilot::update(double elapsed, double stamp, const RigidState<double>& state, double lift) {
  lift_ = lift;
  if (!bursting_) {
    const Inputs inputs = home_.update(elapsed, stamp, state, lift);
    if (home(state) && spare() > kBurstRoom) begin(true, "the craft is home");
    return inputs;
  }
  due_ = false;
  if (signal_.ended(played_ + elapsed - began_)) {
    if (signal_.once) ended_ = elapsed;
    played_ = signal_.once ? signal_.end : 0;
    began_ = elapsed;
  }
  Inputs inputs = signal_.at(played_ + elapsed - began_);
  if (!signal_.has_lift) inputs.lift = lift;
  return inputs;
}

double ExcitationPilot::nextChange(double elapsed) const {
  if (!bursting_) return kByState;
  if (due_) return began_;
  return began_ + signal_.nextChange(played_ + elapsed - began_) - played_;
}

/// Smallest clearance of the planned way home minus the margin [m].
double ExcitationPilot::spare() const {
  const std::vector<TrajectoryOptimizer::State>& way = control_->plan().states();
  const Vector2<double> here = way.front().head<2>();
  const Fence fence(returns_->room, returns_->room.margin);
  double least = std::numeric_limits<double>::infinity();
  for (const TrajectoryOptimizer::State& planned : way) {
    const Vector2<double> stop =
        fence.stoppingPoint({planned.head<3>(), planned.segment<3>(3)}, Fence::kLoss);
    least = std::min(least, returns_->room.clearance(here + (1 + kModelError) * (stop - here)));
  }
  return least - returns_->room.margin;
}

bool ExcitationPilot::home(const RigidState<double>& state) const {
  const Room& room = returns_->room;
  return (state.eta.head<2>() - room.home).norm() <= 0.5 * room.clearance(room.home);
}

void ExcitationPilot::begin(bool burst, const std::string& reason) {
  const double elapsed = std::max(0.0, clock_() - activated_);
  // The interrupted row is not repeated: the signal continues with the next, or repeats at its end.
  if (!burst) played_ = std::min(signal_.end, signal_.nextChange(played_ + elapsed - began_));
  if (!burst && signal_.ended(played_) && !signal_.once) played_ = 0;
  bursting_ = due_ = burst;
  if (burst) {
    began_ = elapsed;
    ++number_;
  }
  marked_({clock_(), number_, burst, reason});
}

}  // namespace ground
