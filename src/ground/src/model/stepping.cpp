#include "ground/model/stepping.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

namespace ground {
namespace {

/// Whether a command equals the one before it.
bool repeats(const InputSequence& inputs, std::size_t command) {
  if (command == 0) return false;
  const Thrusters<double>&now = inputs.thrusters[command], &before = inputs.thrusters[command - 1];
  return inputs.lift[command] == inputs.lift[command - 1] &&
         std::equal(now.begin(), now.end(), before.begin());
}

}  // namespace

void InputSequence::add(double time, const Thrusters<double>& command, double lift_value) {
  if (command.size() != thruster_count)
    throw std::invalid_argument("a command for " + std::to_string(command.size()) +
                                " thrusters goes to a craft with " + std::to_string(thruster_count));
  if (!times.empty() && time < times.back())
    throw std::invalid_argument("commands must be in ascending order of time");
  times.push_back(time);
  thrusters.push_back(command);
  lift.push_back(lift_value);
  drive.command(time, lift_value);
}

void InputSequence::drop(std::size_t count) {
  const auto n = static_cast<std::ptrdiff_t>(count);
  times.erase(times.begin(), times.begin() + n);
  thrusters.erase(thrusters.begin(), thrusters.begin() + n);
  lift.erase(lift.begin(), lift.begin() + n);
}

RigidState<double> Motion::at(double time) const {
  const auto after = std::upper_bound(times->begin(), times->end(), time);
  const auto count = static_cast<Eigen::Index>(times->size());
  const Eigen::Index next = std::min<Eigen::Index>(after - times->begin(), count - 1);
  const Eigen::Index last = std::max<Eigen::Index>(next - 1, 0);
  const double span = (*times)[next] - (*times)[last];
  const double part = span > 0 ? std::clamp((time - (*times)[last]) / span, 0.0, 1.0) : 0.0;
  const auto between = [&](const Eigen::MatrixX3d& rows) -> Vector3<double> {
    return (1 - part) * rows.row(last) + part * rows.row(next);
  };
  return {between(*eta), between(*nu)};
}

Stepping::Stepping(const InputSequence& inputs, double start, double delay, bool varies, double max_step)
    : inputs_(&inputs), time_(start), delay_(delay), max_step_(max_step), varies_(varies) {
  next_ = static_cast<std::size_t>(std::upper_bound(inputs.times.begin(), inputs.times.end(), start - delay) -
                                   inputs.times.begin());
  held_ = next_;
}

std::vector<Stepping::Held> Stepping::before(const Settling& settling) const {
  std::vector<Held> held;
  if (settling.memory <= 0) return held;
  const std::vector<double>& times = inputs_->times;
  const double oldest = time_ - settling.memory;
  const auto first =
      static_cast<std::size_t>(std::upper_bound(times.begin(), times.end(), oldest - delay_) - times.begin());
  // The command before `first` acts from `oldest`, the last one acts until now. These two times do
  // not move with the delay; the changes between commands do.
  for (std::size_t i = first > 0 ? first - 1 : 0; i < next_; ++i) {
    const bool cut = i < first, last = i + 1 == next_;
    const double begin = cut ? oldest : times[i] + delay_;
    const double duration = last  ? time_ - begin
                            : cut ? times[i + 1] + delay_ - begin
                                  : times[i + 1] - times[i];
    const double by_delay = varies_ ? double(cut) - double(last) : 0.0;
    const int pieces = std::max(1, static_cast<int>(std::ceil(duration / settling.step - 1e-9)));
    for (int k = 0; k < pieces; ++k) {
      const double now = begin + k * duration / pieces;
      held.push_back({i, duration / pieces, by_delay / pieces, now + 0.5 * duration / pieces,
                      now - inputs_->drive.origin(now)});
    }
  }
  return held;
}

void Stepping::forget(std::size_t count) {
  if (count >= std::min(held_, next_)) throw std::logic_error("a command that acts must not be forgotten");
  held_ -= count;
  next_ -= count;
}

bool Stepping::next(double time, Stretch& stretch) {
  if (!(time >= time_))
    throw std::invalid_argument("cannot simulate back from " + std::to_string(time_) + " s to " +
                                std::to_string(time) + " s");
  while (next_ < inputs_->size()) {
    const double change = inputs_->times[next_] + delay_;
    if (change > time) break;
    if (repeats(*inputs_, next_)) {  // the same stretch goes on
      held_ = ++next_;
      continue;
    }
    held_ = next_++;
    if (reach(change, varies_, stretch)) return true;
  }
  held_ = next_;
  return reach(time, false, stretch);
}

bool Stepping::reach(double time, bool moves, Stretch& stretch) {
  const double duration = time - time_;
  const double by_delay = double(moves) - double(moves_);
  // A stretch of duration 0 has a derivative if its end moves with the delay.
  if (duration < 0 || (duration == 0 && by_delay == 0)) return false;
  const int steps = std::max(1, static_cast<int>(std::ceil(duration / max_step_ - 1e-9)));
  stretch = {steps, duration / steps, by_delay == 0 ? 0 : by_delay / steps, t()};
  time_ = time;
  moves_ = moves;
  return true;
}

Thrusters<double> Stepping::thrusters() const {
  return held_ == 0 ? Thrusters<double>::zero(inputs_->thruster_count) : inputs_->thrusters[held_ - 1];
}

double Stepping::lift() const { return held_ == 0 ? 0.0 : inputs_->lift[held_ - 1]; }

}  // namespace ground
