#include "ground/simulation/simulated_lab.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

namespace ground {

std::string MocapParams::validate() const {
  return rate >= 1 && rate <= 2000 ? MocapFields::validate() : "rate must be between 1 and 2000 Hz";
}

SimulatedLab::SimulatedLab(Plant& plant, const MocapParams& mocap, const Params& params)
    : plant_(plant),
      watchdog_(params.watchdog),
      random_(params.seed),
      time_(params.start),
      last_command_(params.start),
      next_frame_(params.start),
      tracked_again_(params.start) {
  setMocap(mocap);
}

void SimulatedLab::setMocap(const MocapParams& mocap) {
  const std::string wrong = mocap.validate();
  if (!wrong.empty()) throw std::invalid_argument(wrong);
  mocap_ = mocap;
}

void SimulatedLab::setWatchdog(double watchdog) {
  if (!(std::isfinite(watchdog) && watchdog >= 0))
    throw std::invalid_argument("watchdog must be finite and not negative");
  watchdog_ = watchdog;
}

void SimulatedLab::command(const Thrusters<double>& thrusters, double lift) {
  const auto finite = [](double value) { return std::isfinite(value); };
  if (!std::all_of(thrusters.begin(), thrusters.end(), finite) || !finite(lift))
    throw std::invalid_argument("a command is not finite");
  plant_.command(thrusters, lift);
  off_ = Thrusters<double>::zero(thrusters.size());
  last_command_ = time_;
  expired_ = false;
}

void SimulatedLab::advance(double time) {
  if (!(time >= time_)) throw std::invalid_argument("a room cannot go back in time");
  while (true) {
    const double stop = expired_ || watchdog_ == 0 ? std::numeric_limits<double>::infinity()
                                                   : std::max(time_, last_command_ + watchdog_);
    const double next = std::min({time, next_frame_, stop});
    plant_.advance(next);
    time_ = next;
    if (next == next_frame_) {
      capture();
      next_frame_ += 1 / mocap_.rate;
    } else if (next == stop) {
      plant_.command(off_, 0);
      expired_ = true;
    } else {
      return;
    }
  }
}

void SimulatedLab::capture() {
  // Noise is drawn for every frame, so that a lost frame does not change the noise of the others.
  const double noise[3] = {normal_(random_), normal_(random_), normal_(random_)};
  const Vector3<double> of_plant = plant_.poseNoise();
  if (lost(next_frame_)) return;
  MocapFrame frame;
  frame.captured = next_frame_;
  frame.delivered = next_frame_ + mocap_.latency;
  frame.eta = plant_.measurement().eta + of_plant;
  frame.eta.x() += mocap_.position_noise * noise[0];
  frame.eta.y() += mocap_.position_noise * noise[1];
  frame.eta.z() += mocap_.heading_noise * noise[2];
  on_their_way_.push_back(frame);
}

bool SimulatedLab::lost(double time) {
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  const double single = uniform(random_), begins = uniform(random_), length = uniform(random_);
  if (time < tracked_again_) return true;
  if (begins < 1 - std::exp(-mocap_.gap_rate / mocap_.rate)) {
    tracked_again_ = time + mocap_.gap_length * (mocap_.gaps_vary ? -std::log1p(-length) : 1);
    return true;
  }
  return single < mocap_.loss;
}

std::vector<MocapFrame> SimulatedLab::takeFrames() {
  std::vector<MocapFrame> frames;
  while (!on_their_way_.empty() && on_their_way_.front().delivered <= time_) {
    frames.push_back(on_their_way_.front());
    on_their_way_.pop_front();
  }
  return frames;
}

}  // namespace ground
