#include "ground/simulation/experiment.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <memory>
#include <optional>
#include <stdexcept>
#include <utility>

#include "ground/estimation/velocity_estimator.h"
#include "ground/safety/sender_gate.h"
#include "ground/simulation/simulated_imu.h"

namespace ground {
namespace {

using Command = ExperimentLog::Command;

constexpr double kPatience = 10.0;  // longest wait for a first valid state [s]
const UdpAddress kCraft{1, 1};      // any

/// Source of the craft's commands.
class Driver {
 public:
  virtual ~Driver() = default;
  /// Called with every frame of the mocap.
  virtual void see(double /*now*/, const MocapFrame& /*frame*/) {}
  /// Called with every sample of the craft's gyro and accelerometer.
  virtual void feel(double /*now*/, const ImuSample& /*sample*/) {}
  /// Called at the start if the craft has such sensors.
  virtual void mount(const InertialMounting& /*mounting*/) {}
  /// Called when the craft reports the voltage of its battery [V].
  virtual void voltage(double /*volts*/) {}
  /// The commands that leave for the craft at `now`; called after every event.
  virtual std::vector<Command> act(double now) = 0;
  /// Time of the next act() if there is no frame before, not earlier than the last act() [s].
  virtual double wakesAt() const = 0;
  /// End of the experiment [s]; infinity while it is unknown.
  virtual double end() const = 0;
};

class Player : public Driver {
 public:
  Player(const InputSequence& schedule, double duration, ExperimentLog& log)
      : schedule_(schedule), duration_(duration), log_(log) {
    due_ = schedule_.times.empty() ? duration : std::max(0.0, schedule_.times.front());
  }

  std::vector<Command> act(double now) override {
    if (now < due_ || now >= duration_) return {};
    while (next_ < schedule_.size() && schedule_.times[next_] <= now) ++next_;
    due_ = now + ControllerLifecycle::kKeepalive;
    if (next_ < schedule_.size()) due_ = std::min(due_, schedule_.times[next_]);
    log_.commands.push_back({now, schedule_.thrusters[next_ - 1], schedule_.lift[next_ - 1]});
    return {log_.commands.back()};
  }
  double wakesAt() const override { return due_; }
  double end() const override { return duration_; }

 private:
  const InputSequence& schedule_;
  double duration_;
  ExperimentLog& log_;
  double due_;
  std::size_t next_ = 0;  ///< first command that has not been issued
};

/// A pilot with state estimator, life cycle and sender, like the nodelets MocapState, Controller and Sender.
class LivePilot : public Driver {
 public:
  LivePilot(const DriveParams& params, const Hazards& hazards, const Model& believed, ExperimentLog& log)
      : params_(params),
        estimator_(params.estimator),
        upright_time_(hazards.upright_time),
        log_(log),
        layout_(believed.thrusters),
        gate_(
            params.link, kCraft,
            [this](const MotorCommand& command, const UdpAddress&) { return leave(command); },
            believed.thrusters) {
    if (hazards.confused()) confused_.emplace(hazards);
    gate_.setCraft(believed);
    if (params.room) gate_.setFence(Fence(*params.room, 0));
  }

  /// Sets the pilot, which must outlive it.
  void take(Pilot& pilot) {
    pilot_ = &pilot;
    life_ = std::make_unique<ControllerLifecycle>(
        pilot, [this](const Inputs& inputs) { send(inputs); },
        [this] {
          log_.stages.push_back({now_, life_->current(), life_->reason()});
        });
    life_->setParams(params_.life);
    if (params_.room) life_->setFence(Fence(*params_.room, params_.room->margin));
  }

  double now() const { return now_; }

  void see(double now, const MocapFrame& frame) override {
    now_ = now;
    MeasuredState measured;
    measured.stamp = frame.captured;
    measured.valid = true;
    if (params_.estimate) {
      const StateEstimate& estimate = estimated(now, frame);
      if (!estimate.used && (estimate.ignored || estimate.valid)) return;
      measured.state = {estimate.eta, estimate.nu};
      measured.nu_variance = estimate.nu_covariance.diagonal();
      measured.pose = estimate.pose;
      measured.valid = estimate.valid && now - leaned_ >= upright_time_;
      measured.problem = estimate.valid ? "the craft leaned too far a moment ago" : estimate.status;
    } else {
      const auto truth = std::find_if(log_.truth.rbegin(), log_.truth.rend(),
                                      [&](const auto& t) { return t.time <= frame.captured; });
      measured.state = truth->measured;
      measured.pose = poseMeasurement(truth->measured.eta, params_.estimator.position_noise,
                                      params_.estimator.heading_noise);
    }
    seen_.received({now, now}, measured.stamp, measured.valid && measured.finite(), measured.problem);
    gate_.state({now, now}, measured);
    arm();
    life_->state({now, now}, measured);
    report();
  }

  void feel(double now, const ImuSample& sample) override {
    const auto& [ahead, starboard] = sample.acceleration;
    estimator_.inertial().sample(now, sample.yaw_rate, Vector2<double>(ahead, starboard));
  }
  void mount(const InertialMounting& mounting) override { estimator_.inertial().setMounting(mounting); }

  void voltage(double volts) override {
    gate_.voltage(volts);
    life_->attempt([&] { pilot_->voltage(volts); });
  }

  std::vector<Command> act(double now) override {
    now_ = now;
    const Instant instant{now, now};
    if (life_->current() == Stage::kIdle && now >= params_.start) life_->start(instant);
    if (life_->current() == Stage::kWaiting && now >= params_.start + kPatience)
      life_->stop(instant, "there was no valid state to start with");
    life_->tick(instant);
    gate_.tick(instant);
    if (arm())
      life_->tick(instant);
    else if (!armed_ && life_->current() == Stage::kWaiting &&
             seen_.problem(instant, params_.link.state_timeout).empty())
      life_->stop(instant, "the sender cannot be armed: " + unarmed_);
    report();
    if (!std::isfinite(end_) && (life_->current() == Stage::kDone || life_->current() == Stage::kStopped)) {
      log_.stopped = life_->current() == Stage::kStopped ? life_->reason() : "";
      log_.stopped_at = now;
      end_ = now + params_.tail;
    }
    return std::exchange(packets_, {});
  }

  double wakesAt() const override {
    const Instant due = life_->due();
    double wakes = std::min(due.steady, due.time);
    if (life_->current() == Stage::kIdle) wakes = std::min(wakes, params_.start);
    if (life_->current() == Stage::kWaiting) wakes = std::min(wakes, params_.start + kPatience);
    return std::max(wakes, now_);  // a first command is due at once
  }

  double end() const override { return end_; }

 private:
  using Stage = ControllerLifecycle::State;

  /// As mocap_state estimates: a pose that seems to lean is rejected.
  const StateEstimate& estimated(double now, const MocapFrame& frame) {
    if (!confused_) return estimator_.update(frame.captured, frame.eta);
    const char* why = nullptr;
    const auto eta = confused_->seen(frame.eta, &why);
    if (eta) return estimator_.update(frame.captured, *eta);
    const StateEstimate& estimate = estimator_.reject(why);
    if (!estimate.valid) leaned_ = now;
    return estimate;
  }

  /// The controller gives a command.
  void send(const Inputs& inputs) {
    log_.commands.push_back({now_, inputs.thrusters, inputs.lift});
    life_->attempt([&] { pilot_->commanded(now_, inputs); });
    gate_.command({now_, now_}, now_, "the controller", inputs);
  }

  /// A command leaves for the craft.
  std::string leave(const MotorCommand& command) {
    packets_.push_back({now_, layout_->clipped(command.thrusters), std::clamp(command.lift, 0.0, 1.0)});
    log_.sent.push_back(packets_.back());
    return "";
  }

  /// Arms once, as soon as it is possible after the start; returns whether it has just been.
  bool arm() {
    if (armed_ || life_->current() == Stage::kIdle) return false;
    unarmed_ = gate_.link({now_, now_}).arm(now_);
    armed_ = unarmed_.empty();
    report();
    return armed_;
  }

  /// Tells the controller whether the sender is armed.
  void report() { life_->sender({now_, now_}, gate_.armed(), gate_.link().reason()); }

  DriveParams params_;
  VelocityEstimator estimator_;
  std::optional<ConfusedAxes> confused_;
  double upright_time_;                                       ///< [s]
  double leaned_ = -std::numeric_limits<double>::infinity();  ///< when the craft last seemed to lean [s]
  ExperimentLog& log_;
  ThrusterLayoutPtr layout_;
  Pilot* pilot_ = nullptr;
  std::unique_ptr<ControllerLifecycle> life_;
  double now_ = 0;  ///< [s]
  SenderGate gate_;
  StateLoss seen_;
  bool armed_ = false;            ///< it has been armed
  std::string unarmed_;           ///< why it could not be
  std::vector<Command> packets_;  ///< commands that act() has not yet returned
  double end_ = std::numeric_limits<double>::infinity();
};

/// A controller by a law, which must outlive it.
class LawControl : public TrackingController {
 public:
  LawControl(const ControlLaw& law, const Model& model) : law_(law), model_(model) {}

  Thrusters<double> decide(const Observation& seen) override {
    const double time = std::max(0.0, seen.stamp - seen.reference_start);
    const ReferencePoint at = seen.reference->at(time);
    wanted_ = model_.body.input_max *
              law_(seen.state.eta, seen.state.nu, {at.p, at.p_dot, at.p_ddot, at.p_dddot}, time);
    return model_.thrusters->clipped(wanted_, model_.body.input_max);
  }
  Thrusters<double> wanted() const override { return wanted_; }

 private:
  const ControlLaw& law_;
  Model model_;
  Thrusters<double> wanted_;
};

void note(const SimulatedLab& room, ExperimentLog& log) {
  const RigidState<double>& state = room.state();
  if (!state.eta.allFinite() || !state.nu.allFinite()) {
    char text[160];
    std::snprintf(text, sizeof text,
                  "the simulated motion is not finite at %.3f s: the model is unstable, or too fast "
                  "for steps of %g ms",
                  room.time(), 1000 * kDefaultStep);
    throw std::runtime_error(text);
  }
  const Measurement<double> seen = room.measurement();
  log.truth.push_back(
      {room.time(), state, room.derivative().nu, {seen.eta, seen.nu}, room.wrench(), room.voltage()});
}

/// The gyro and accelerometer of the craft, if it has them.
class Sensors {
 public:
  Sensors(const ExperimentParams& params, Driver& driver)
      : driver_(driver), imu_(static_cast<unsigned>(params.seed)), period_(1 / params.imu_rate) {
    if (!(params.imu_rate > 0)) return;
    driver_.mount(imu_.mounting());
    next_ = 0;
  }

  double next() const { return next_; }
  /// Takes a sample if one is due.
  void sample(const SimulatedLab& room) {
    if (room.time() < next_) return;
    driver_.feel(room.time(), imu_.sample(room.state(), room.derivative().nu));
    next_ += period_;
  }

 private:
  Driver& driver_;
  SimulatedImu imu_;
  double period_;                                          ///< [s]
  double next_ = std::numeric_limits<double>::infinity();  ///< time of the next sample [s]
};

void run(const Model& model, Driver& driver, const ExperimentParams& params, ExperimentLog& log) {
  SimulatedLab::Params place;
  place.initial = params.initial;
  place.seed = params.seed;
  place.disturbance = params.disturbance;
  const Hazards& hazards = params.hazards;
  place.braking = hazards.braking;
  place.push = {hazards.push, hazards.pushed.from, hazards.pushed.from + hazards.pushed.duration};
  place.battery = params.battery;
  std::optional<ModelCraft> own;
  if (!params.plant) own.emplace(model, place);
  SimulatedLab room(params.plant ? *params.plant : *own, params.mocap, place);
  Sensors sensors(params, driver);
  const double input_max = model.body.input_max;
  while (true) {
    const double captures = room.nextCapture();
    const double now =
        std::min({captures, sensors.next(), room.nextDelivery(), driver.wakesAt(), driver.end()});
    room.advance(now);
    sensors.sample(room);
    if (now == captures) note(room, log);
    if (now == captures && room.voltage() > 0) driver.voltage(room.voltage());
    for (MocapFrame& frame : room.takeFrames()) {
      if (hazards.unseen.covers(frame.captured)) continue;
      frame.eta.z() = wrapAngle(frame.eta.z());
      log.frames.push_back(frame);
      driver.see(now, frame);
    }
    if (now >= driver.end()) return;
    for (const Command& command : driver.act(now))
      if (!hazards.unheard.covers(now)) room.command(input_max * asVector(command.thrusters), command.lift);
  }
}

void require(const std::string& wrong) {
  if (!wrong.empty()) throw std::invalid_argument(wrong);
}

}  // namespace

std::string DriveParams::validate() const {
  const auto within = [](double x, double low, double high) { return x >= low && x <= high; };
  if (!within(start, 0, 3600)) return "start must be between 0 and 3600 s";
  if (!(duration > 0) || !std::isfinite(duration)) return "duration must be positive";
  if (!within(tail, 0, 3600)) return "tail must be between 0 and 3600 s";
  for (const std::string& wrong :
       {life.validate(), link.validate(), estimator.validate(), room ? room->validate() : std::string()})
    if (!wrong.empty()) return wrong;
  return "";
}

ExperimentLog playSchedule(const Model& model, const InputSequence& schedule, double duration,
                           const ExperimentParams& params) {
  if (!(duration > 0) || !std::isfinite(duration)) throw std::invalid_argument("duration must be positive");
  Dynamics<double>(model).requireThrusters(schedule.thruster_count);
  for (std::size_t i = 0; i < schedule.size(); ++i) {
    const Thrusters<double> inside = model.thrusters->clipped(schedule.thrusters[i]);
    for (int j = 0; j < inside.size(); ++j)
      if (inside(j) != schedule.thrusters[i](j))
        throw std::invalid_argument("an input is outside the range of its thruster");
    if (!(schedule.lift[i] >= 0 && schedule.lift[i] <= 1))
      throw std::invalid_argument("the lift must be between 0 and 1");
  }
  ExperimentLog log;
  Player player(schedule, duration, log);
  run(model, player, params, log);
  return log;
}

ExperimentLog trackReference(const Model& model, const Model& believed, const TrackingParams& tracking,
                             const ExperimentParams& params) {
  require(tracking.validate());
  require(params.hazards.validate());
  require(tracking.max_error >= 0 ? "" : "max_error must not be negative");
  Dynamics<double>(model).requireThrusters(believed.thrusters->size());
  ExperimentLog log;
  LivePilot live(tracking, params.hazards, believed, log);
  ReferencePilot pilot([&live] { return live.now(); },
                       [&log](const ReferencePilot::Decision& made) {
                         log.decisions.push_back(made);
                         if (log.references.empty() || made.stamp > log.references.back().time)
                           log.references.push_back({made.stamp, made.reference});
                       });
  std::unique_ptr<TrackingController> controller;
  if (tracking.law) {
    controller = std::make_unique<LawControl>(tracking.law, believed);
  } else {
    controller = makeController(believed, tracking.controller);
    if (tracking.room) controller->avoid({Fence(*tracking.room, tracking.room->margin), Fence::kLoss});
  }
  ReferencePtr reference = makeReference(tracking.reference);
  pilot.setMaxError(tracking.max_error > 0 ? tracking.max_error : defaultMaxError(*reference));
  pilot.setDuration(tracking.duration);
  pilot.swapController(controller, believed);
  pilot.swapReference(reference);
  live.take(pilot);
  run(model, live, params, log);
  return log;
}

ExperimentLog excite(const Model& model, const Model& believed, const ExcitationParams& excitation,
                     const ExperimentParams& params) {
  require(excitation.validate());
  require(params.hazards.validate());
  Dynamics<double>(model).requireThrusters(believed.thrusters->size());
  ExperimentLog log;
  LivePilot live(excitation, params.hazards, believed, log);
  ExcitationPilot pilot([&live] { return live.now(); },
                        [&log](const ExcitationPilot::Mark& mark) { log.marks.push_back(mark); },
                        [&log](const ReferencePilot::Decision& made) { log.decisions.push_back(made); });
  DesignParams design = excitation.design;
  design.thrusters = believed.thrusters;
  InputSignal signal = makeDesign(design, excitation.duration);
  if (excitation.room) {
    ReturnParams returns = excitation.returns;
    returns.room = *excitation.room;
    pilot.playInside(std::move(signal), excitation.duration, believed, returns);
  } else {
    pilot.play(std::move(signal), excitation.duration);
  }
  live.take(pilot);
  run(model, live, params, log);
  return log;
}

}  // namespace ground
