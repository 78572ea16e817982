#include "ground/simulation/room.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

namespace ground {

std::string MocapParams::validate() const {
  const auto within = [](double x, double low, double high) { return x >= low && x <= high; };
  if (!within(rate, 1, 2000)) return "rate must be between 1 and 2000 Hz";
  if (!within(position_noise, 0, 1)) return "position_noise must be between 0 and 1 m";
  if (!within(heading_noise, 0, 3)) return "heading_noise must be between 0 and 3 rad";
  if (!within(latency, 0, 1)) return "latency must be between 0 and 1 s";
  if (!within(loss, 0, 1)) return "loss must be between 0 and 1";
  if (!within(gap_rate, 0, 100)) return "gap_rate must be between 0 and 100 per second";
  if (!within(gap_length, 0, 100)) return "gap_length must be between 0 and 100 s";
  return "";
}

Room::Room(const Model& model, const MocapParams& mocap, const Params& params)
    : params_(params),
      source_(params.disturbance.empty()
                  ? std::nullopt
                  : std::make_optional<DisturbanceSource>(params.disturbance, kDefaultStep,
                                                          params.seed)),
      next_wrench_(params.start),
      model_(onThisRun(model)),
      moving_(std::make_unique<Moving>(model_, inputs_, params.initial, params.start)),
      random_(params.seed),
      time_(params.start),
      last_command_(params.start),
      next_frame_(params.start),
      tracked_again_(params.start) {
  setMocap(mocap);
}

/// The model with the disturbance's factor on the thrust of this run.
Model Room::onThisRun(Model model) const {
  if (source_) model.body.k *= source_->thrustFactor();
  return model;
}

RigidState<double> Room::derivative() const {
  RigidState<double> rate = moving_->simulation.derivative();
  if (source_) rate.nu += moving_->mobility * wrench_;
  if (sits()) {
    const Vector3<double> most = friction();
    for (int i = 0; i < 3; ++i) {
      const double nu = state().nu(i);
      // At rest, friction cancels accelerations up to its limit.
      rate.nu(i) -= nu != 0 ? std::copysign(most(i), nu) : std::clamp(rate.nu(i), -most(i), most(i));
    }
  }
  return rate;
}

/// Largest decelerations by dry friction of the skirt without lift: along u and v [m/s^2] and in
/// yaw [rad/s^2]. The friction's lever is taken as that of the thrusters.
Vector3<double> Room::friction() const {
  const Vector3<double>& nu = state().nu;
  const double speed = nu.head<2>().norm();
  const Body<double>& body = model_.body;
  const double turning = params_.braking * body.m * body.l / body.I_z;
  const double along_u = speed > 0 ? std::abs(nu.x()) / speed : 1;
  const double along_v = speed > 0 ? std::abs(nu.y()) / speed : 1;
  return {params_.braking * along_u, params_.braking * along_v, turning};
}

/// Moves the craft under the disturbance and friction of the floor. Half of the impulse of the
/// wrench acts before each step and half after it. Friction does not reverse the velocity.
void Room::move(double time) {
  Simulation<double>& simulation = moving_->simulation;
  while ((source_ || sits()) && simulation.time() < time) {
    double until = time;
    Vector3<double> push = Vector3<double>::Zero();
    if (source_) {
      if (simulation.time() >= next_wrench_) {
        wrench_ = source_->next();
        next_wrench_ = params_.start + static_cast<double>(++drawn_) * kDefaultStep;
      }
      until = std::min(until, next_wrench_);
    }
    if (sits()) until = std::min(until, simulation.time() + kDefaultStep);
    const double dt = until - simulation.time();
    if (source_) push = 0.5 * dt * (moving_->mobility * wrench_);
    for (const bool before : {true, false}) {
      Vector3<double>& nu = simulation.state().nu;
      nu += push;
      const Vector3<double> most = sits() ? (0.5 * dt * friction()).eval() : Vector3<double>::Zero();
      for (int i = 0; i < 3; ++i) nu(i) -= std::clamp(nu(i), -most(i), most(i));
      if (before) simulation.advance(until);
    }
  }
  simulation.advance(time);
}

void Room::setModel(const Model& model) {
  const RigidState<double> here = state();
  InputSequence inputs = inputs_;
  for (auto& thrusters : inputs.thrusters)
    thrusters *= model.body.input_max / model_.body.input_max;
  const Model other = onThisRun(model);
  const Moving probe(other, inputs, here, time_);
  const RigidState<double> rate = probe.simulation.derivative();
  if (!rate.eta.allFinite() || !rate.nu.allFinite())
    throw std::invalid_argument("the craft's acceleration by this model is not finite");
  model_ = other;
  inputs_ = std::move(inputs);
  moving_ = std::make_unique<Moving>(model_, inputs_, here, time_);
}

void Room::setMocap(const MocapParams& mocap) {
  const std::string wrong = mocap.validate();
  if (!wrong.empty()) throw std::invalid_argument(wrong);
  mocap_ = mocap;
}

void Room::setWatchdog(double watchdog) {
  if (!(std::isfinite(watchdog) && watchdog >= 0))
    throw std::invalid_argument("watchdog must be finite and not negative");
  params_.watchdog = watchdog;
}

void Room::command(double left, double right, double lift) {
  if (!std::isfinite(left) || !std::isfinite(right) || !std::isfinite(lift))
    throw std::invalid_argument("a command is not finite");
  const double most = model_.body.input_max;
  inputs_.add(time_, std::clamp(left, 0.0, most), std::clamp(right, 0.0, most),
              std::clamp(lift, 0.0, 1.0));
  last_command_ = time_;
  if (lift_ || lift > 0) lift_ = std::clamp(lift, 0.0, 1.0);
  expired_ = false;
  forgetCommands();
}

/// Drops commands that no longer act, many at once, because an experiment may last for hours.
void Room::forgetCommands() {
  constexpr std::size_t kMaxCommands = 20000;
  constexpr double kMemory = kActuatorMemory + 5;  // includes the longest input delay [s]
  if (inputs_.size() < kMaxCommands) return;
  const auto recent = std::lower_bound(inputs_.times.begin(), inputs_.times.end(), time_ - kMemory);
  const auto old = static_cast<std::size_t>(recent - inputs_.times.begin());
  if (old < 2) return;
  inputs_.drop(old - 1);
  moving_->simulation.forget(old - 1);
}

void Room::advance(double time) {
  if (!(time >= time_)) throw std::invalid_argument("a room cannot go back in time");
  while (true) {
    const double stop = expired_ || params_.watchdog == 0
                            ? std::numeric_limits<double>::infinity()
                            : std::max(time_, last_command_ + params_.watchdog);
    const double next = std::min({time, next_frame_, stop});
    move(next);
    time_ = next;
    if (next == next_frame_) {
      capture();
      next_frame_ += 1 / mocap_.rate;
    } else if (next == stop) {
      inputs_.add(stop, 0, 0, 0);
      if (lift_) lift_ = 0;
      expired_ = true;
    } else {
      return;
    }
  }
}

void Room::capture() {
  // Draws for every frame, so that a lost frame does not change the noise of the others.
  const double noise[3] = {normal_(random_), normal_(random_), normal_(random_)};
  if (lost(next_frame_)) return;
  MocapFrame frame;
  frame.captured = next_frame_;
  frame.delivered = next_frame_ + mocap_.latency;
  frame.eta = moving_->simulation.measure().eta;
  frame.eta.x() += mocap_.position_noise * noise[0];
  frame.eta.y() += mocap_.position_noise * noise[1];
  frame.eta.z() += mocap_.heading_noise * noise[2];
  on_their_way_.push_back(frame);
}

bool Room::lost(double time) {
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  const double single = uniform(random_), begins = uniform(random_), length = uniform(random_);
  if (time < tracked_again_) return true;
  if (begins < 1 - std::exp(-mocap_.gap_rate / mocap_.rate)) {
    tracked_again_ = time + mocap_.gap_length * (mocap_.gaps_vary ? -std::log1p(-length) : 1);
    return true;
  }
  return single < mocap_.loss;
}

std::vector<MocapFrame> Room::takeFrames() {
  std::vector<MocapFrame> frames;
  while (!on_their_way_.empty() && on_their_way_.front().delivered <= time_) {
    frames.push_back(on_their_way_.front());
    on_their_way_.pop_front();
  }
  return frames;
}

}  // namespace ground
