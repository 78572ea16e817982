#include "ground/simulation/experiment.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <limits>
#include <memory>
#include <optional>
#include <stdexcept>
#include <utility>

#include "ground/control/tracking_watch.h"
#include "ground/estimation/velocity_estimator.h"
#include "ground/model/drive_clock.h"

namespace ground {
namespace {

using Command = ExperimentLog::Command;

constexpr double kKeepalive = 0.02;    // between repeated commands [s]
constexpr double kStateTimeout = 0.2;  // oldest state with which to drive [s]
constexpr double kPatience = 10.0;     // for a first valid state [s]

/// Whoever commands the craft.
class Driver {
 public:
  virtual ~Driver() = default;
  /// A frame of the mocap comes in.
  virtual void see(const MocapFrame& /*frame*/) {}
  /// The command to issue at `now`, if any; called after every event.
  virtual std::optional<Command> act(double now) = 0;
  /// When it has to act next even if no frame comes, after the instant of the last act() [s].
  virtual double wakesAt() const = 0;
  /// When the experiment is over [s]; infinity as long as that is open.
  virtual double end() const = 0;
};

class Player : public Driver {
 public:
  Player(const InputSequence& schedule, double duration)
      : schedule_(schedule), duration_(duration) {
    due_ = schedule_.times.empty() ? duration : std::max(0.0, schedule_.times.front());
  }

  std::optional<Command> act(double now) override {
    if (now < due_ || now >= duration_) return std::nullopt;
    while (next_ < schedule_.size() && schedule_.times[next_] <= now) ++next_;
    due_ = now + kKeepalive;
    if (next_ < schedule_.size()) due_ = std::min(due_, schedule_.times[next_]);
    const Vector2<double>& thrusters = schedule_.thrusters[next_ - 1];
    return Command{now, thrusters.x(), thrusters.y(), schedule_.lift[next_ - 1]};
  }
  double wakesAt() const override { return due_; }
  double end() const override { return duration_; }

 private:
  const InputSequence& schedule_;
  double duration_;
  double due_;
  std::size_t next_ = 0;  ///< first command that has not been issued
};

/// Processor time of this thread [s]: what else the machine does is no part of it.
double processorTime() {
  timespec time;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

/// The life of nodelets MocapState and Controller, without their clocks.
class Tracker : public Driver {
 public:
  Tracker(const Model& believed, const TrackingParams& params, ExperimentLog& log)
      : controller_(makeController(believed, params.controller)),
        input_max_(believed.body.input_max),
        params_(params),
        reference_(makeReference(params.reference)),
        estimator_(makeKalmanEstimator(params.estimator)),
        log_(log) {
    watch_.setMaxError(params.max_error > 0 ? params.max_error : defaultMaxError(*reference_));
  }

  void see(const MocapFrame& frame) override {
    if (params_.estimate) {
      const StateEstimate& estimate = estimator_->update(frame.captured, frame.eta);
      if (!estimate.used && (estimate.ignored || estimate.valid)) return;
      state_ = {estimate.eta, estimate.nu};
    } else {
      const auto truth = std::find_if(log_.truth.rbegin(), log_.truth.rend(),
                                      [&](const auto& t) { return t.time <= frame.captured; });
      state_ = truth->measured;
    }
    stamp_ = frame.captured;
    fresh_ = true;
  }

  std::optional<Command> act(double now) override {
    const std::optional<Command> command = choose(now);
    if (command) {
      drive_.command(now, command->lift);
      controller_->commanded(now, input_max_ * Vector2<double>(command->left, command->right),
                             command->lift);
    }
    return command;
  }

  double wakesAt() const override {
    switch (phase_) {
      case Phase::kWaiting:
        // A frame may be just what is missing; its delivery is an event of its own.
        return keepalive_;
      case Phase::kLifting:
        return std::min({keepalive_, since_ + params_.lift_time, stamp_ + kStateTimeout});
      case Phase::kRunning:
        return std::min(since_ + params_.duration, stamp_ + kStateTimeout);
      default:
        return keepalive_;
    }
  }

  double end() const override { return end_; }

 private:
  enum class Phase { kWaiting, kLifting, kRunning, kFinished };

  std::optional<Command> choose(double now) {
    const bool fresh = std::exchange(fresh_, false);
    const std::string problem = stateProblem(now);
    if (phase_ == Phase::kWaiting && now >= kPatience + params_.start)
      return finish(now, "there was no valid state to start with");
    if (phase_ == Phase::kWaiting && now >= params_.start && problem.empty())
      return enter(Phase::kLifting, now);
    if ((phase_ == Phase::kLifting || phase_ == Phase::kRunning) && !problem.empty())
      return finish(now, problem);
    if (phase_ == Phase::kLifting && now >= since_ + params_.lift_time) {
      phase_ = Phase::kRunning;
      since_ = now;
    }
    if (phase_ == Phase::kRunning) {
      if (now >= since_ + params_.duration) return finish(now, "");
      return fresh ? control(now) : std::nullopt;
    }
    if (now < keepalive_) return std::nullopt;
    return idle(now);
  }

  std::string stateProblem(double now) const {
    const StateEstimate& estimate = estimator_->estimate();
    if (params_.estimate && !estimate.valid)
      return std::string("the state is invalid: ") + estimate.status;
    if (now >= stamp_ + kStateTimeout) return "the state is stale";
    return "";
  }

  std::optional<Command> enter(Phase phase, double now) {
    phase_ = phase;
    since_ = now;
    return idle(now);
  }

  std::optional<Command> finish(double now, const std::string& why) {
    log_.stopped = why;
    log_.stopped_at = now;
    end_ = now + params_.tail;
    return enter(Phase::kFinished, now);
  }

  /// What goes out while the law is not at work.
  Command idle(double now) {
    keepalive_ = now + kKeepalive;
    return {now, 0, 0, phase_ == Phase::kLifting ? params_.lift : 0.0};
  }

  std::optional<Command> control(double now) {
    // A tenth of tolerance, so that jitter does not skip every other state.
    if (last_update_ && stamp_ - *last_update_ < 0.9 / params_.rate) return std::nullopt;
    if (!last_update_) reference_start_ = stamp_;
    last_update_ = stamp_;
    const ReferencePoint wanted = reference_->at(stamp_ - reference_start_);
    if (controller_->follows()) {
      const double error = (controller_->position(state_) - wanted.p).norm();
      const std::string lost = watch_.look(stamp_ - reference_start_, error);
      if (!lost.empty()) return finish(now, lost);
    }
    const double before = processorTime();
    const Vector2<double> thrusters =
        controller_->decide({now, stamp_, state_, reference_.get(), reference_start_, params_.lift,
                             drive_.origin(now)});
    log_.decisions.push_back({now, thrusters, processorTime() - before});
    if (!thrusters.allFinite()) return finish(now, "the command is not finite");
    log_.references.push_back({stamp_, wanted});
    const Vector2<double> inputs = thrusters / input_max_;
    return Command{now, inputs.x(), inputs.y(), params_.lift};
  }

  std::unique_ptr<TrackingController> controller_;
  double input_max_;
  TrackingParams params_;
  ReferencePtr reference_;
  TrackingWatch watch_;
  std::unique_ptr<VelocityEstimator> estimator_;
  ExperimentLog& log_;
  Phase phase_ = Phase::kWaiting;
  double since_ = 0;                                         ///< start of the phase [s]
  double keepalive_ = 0;                                     ///< next repeated command [s]
  double stamp_ = -std::numeric_limits<double>::infinity();  ///< of the newest state [s]
  RigidState<double> state_;                                 ///< the newest
  bool fresh_ = false;                                       ///< it has not been acted upon
  std::optional<double> last_update_;                        ///< stamp of the state last used [s]
  double reference_start_ = 0;                               ///< [s]
  DriveClock drive_;
  double end_ = std::numeric_limits<double>::infinity();
};

void note(const Room& room, ExperimentLog& log) {
  const RigidState<double>& state = room.state();
  if (!state.eta.allFinite() || !state.nu.allFinite()) {
    char text[160];
    std::snprintf(
        text, sizeof text,
        "the simulated motion is not finite at %.3f s: the model is unstable, or too fast "
        "for steps of %g ms",
        room.time(), 1000 * kDefaultStep);
    throw std::runtime_error(text);
  }
  const Measurement<double> seen = room.measurement();
  log.truth.push_back({room.time(), state, room.derivative().nu, {seen.eta, seen.nu},
                       room.wrench()});
}

void run(const Model& model, Driver& driver, const ExperimentParams& params, ExperimentLog& log) {
  Room::Params place;
  place.initial = params.initial;
  place.seed = params.seed;
  place.disturbance = params.disturbance;
  Room room(model, params.mocap, place);
  const double input_max = model.body.input_max;
  while (true) {
    const double captures = room.nextCapture();
    const double now = std::min({captures, room.nextDelivery(), driver.wakesAt(), driver.end()});
    room.advance(now);
    if (now == captures) note(room, log);
    for (MocapFrame& frame : room.takeFrames()) {
      frame.eta.z() = wrapAngle(frame.eta.z());
      log.frames.push_back(frame);
      driver.see(frame);
    }
    if (now >= driver.end()) return;
    if (const std::optional<Command> command = driver.act(now)) {
      const bool deaf = now >= params.deaf_from && now < params.deaf_until;
      if (!deaf)
        room.command(input_max * command->left, input_max * command->right, command->lift);
      log.commands.push_back(*command);
    }
  }
}

void require(const std::string& wrong) {
  if (!wrong.empty()) throw std::invalid_argument(wrong);
}

}  // namespace

std::string TrackingParams::validate() const {
  const auto within = [](double x, double low, double high) { return x >= low && x <= high; };
  if (!within(rate, 10, 500)) return "the control rate must be between 10 and 500 Hz";
  if (!within(start, 0, 3600)) return "start must be between 0 and 3600 s";
  if (!within(lift, 0, 1)) return "lift must be between 0 and 1";
  if (!within(lift_time, 0, 30)) return "lift_time must be between 0 and 30 s";
  if (!(duration > 0) || !std::isfinite(duration)) return "duration must be positive";
  if (!(max_error >= 0)) return "max_error must not be negative";
  if (!within(tail, 0, 3600)) return "tail must be between 0 and 3600 s";
  const std::string wrong = controller.validate();
  return wrong.empty() ? estimator.validate() : wrong;
}

ExperimentLog playSchedule(const Model& model, const InputSequence& schedule, double duration,
                           const ExperimentParams& params) {
  if (!(duration > 0) || !std::isfinite(duration))
    throw std::invalid_argument("duration must be positive");
  for (std::size_t i = 0; i < schedule.size(); ++i) {
    const Vector2<double>& thrusters = schedule.thrusters[i];
    for (double input : {thrusters.x(), thrusters.y(), schedule.lift[i]})
      if (!(input >= 0 && input <= 1))
        throw std::invalid_argument("inputs must be between 0 and 1");
  }
  ExperimentLog log;
  Player player(schedule, duration);
  run(model, player, params, log);
  return log;
}

ExperimentLog trackReference(const Model& model, const Model& believed,
                             const TrackingParams& tracking, const ExperimentParams& params) {
  require(tracking.validate());
  ExperimentLog log;
  Tracker tracker(believed, tracking, log);
  run(model, tracker, params, log);
  return log;
}

}  // namespace ground
