#include "ground/model/simulation.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

namespace ground {
namespace {

[[noreturn]] void refuseTime(double from, double to) {
  throw std::invalid_argument("cannot simulate back from " + std::to_string(from) + " s to " +
                              std::to_string(to) + " s");
}

/// Whether a command equals the one before it.
bool repeats(const InputSequence& inputs, std::size_t command) {
  if (command == 0) return false;
  const Thrusters<double>&now = inputs.thrusters[command], &before = inputs.thrusters[command - 1];
  return inputs.lift[command] == inputs.lift[command - 1] &&
         std::equal(now.begin(), now.end(), before.begin());
}

}  // namespace

Stepping::Stepping(const InputSequence& inputs, double start, double delay, bool varies, double max_step)
    : inputs_(&inputs),
      off_(Thrusters<double>::zero(inputs.thruster_count)),
      time_(start),
      delay_(delay),
      steps_per_second_(1 / max_step),
      varies_(varies) {
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

GROUND_INLINE bool Stepping::reach(double time, bool moves, Stretch& stretch) {
  const double duration = time - time_;
  const int by_delay = int(moves) - int(moves_);
  // A stretch of duration 0 has a derivative if its end moves with the delay.
  if (duration < 0 || (duration == 0 && by_delay == 0)) return false;
  const int steps = std::max(1, static_cast<int>(std::ceil(duration * steps_per_second_ - 1e-9)));
  const double share = 1.0 / steps;
  stretch = {steps, share * duration, share * by_delay, t()};
  time_ = time;
  moves_ = moves;
  return true;
}

bool Stepping::next(double time, Stretch& stretch) {
  if (!(time >= time_)) refuseTime(time_, time);
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

template <typename T>
Simulation<T>::Simulation(const Dynamics<T>& dynamics, const InputSequence& inputs,
                          const RigidState<T>& initial, double start, double max_step, const Motion* measured)
    : dynamics_(dynamics),
      stepping_(inputs, start, valueOf(dynamics.inputDelay()), !isConstant(dynamics.inputDelay()), max_step),
      state_(initial),
      effect_states_(dynamics.initialStates()),
      t_(stepping_.t()) {
  dynamics_.requireThrusters(inputs.thruster_count);
  for (const Stepping::Held& held : stepping_.before(dynamics_.settling()))
    dynamics_.settle(T(held.t), measured ? cast<T>(measured->at(held.time)) : state_,
                     inputs.thrusters[held.command].template cast<T>(),
                     {inputs.lift[held.command], inputs.battery.at(held.time)},
                     dynamics_.withDelay(held.duration, held.by_delay), effect_states_.data());
}

template <typename T>
void Simulation<T>::restart(const RigidState<T>& state) {
  state_ = state;
  for (T& own : effect_states_) own = T(valueOf(own));
}

template <typename T>
void Simulation<T>::advance(double time) {
  Stretch stretch;
  while (stepping_.next(time, stretch)) {
    setValue(t_, stretch.t);
    if (stepping_.varied()) acts_ = kNone;
    if (stretch.by_delay == 0)
      step(stretch.steps, stretch.h);
    else
      step(stretch.steps, dynamics_.withDelay(stretch.h, stretch.by_delay));
  }
}

template <typename T>
template <typename H>
void Simulation<T>::step(int steps, const H& h) {
  const double middle = stepping_.time() - 0.5 * steps * valueOf(h);
  const auto act = [&](T* states) {
    return dynamics_.actuate(stepping_.thrusters().template cast<T>(), conditionsAt(middle), T(h), states);
  };
  if (!dynamics_.hasMemory()) {
    if (acts_ != stepping_.held()) acting_ = act(nullptr);
    acts_ = stepping_.held();
    return dynamics_.step(t_, state_, *acting_, h, steps, pose_);
  }
  for (int i = 0; i < steps; ++i) dynamics_.step(t_, state_, act(effect_states_.data()), h, 1, pose_);
}

template <typename T>
Thrusters<T> Simulation<T>::actuated() const {
  std::vector<T> states = effect_states_;
  return dynamics_
      .actuate(stepping_.thrusters().template cast<T>(), conditionsAt(time()), T(0.0), states.data())
      .thrusters[0];
}

template <typename T>
RigidState<T> Simulation<T>::derivative() const {
  T t = t_;
  setValue(t, stepping_.t());
  return dynamics_.derivative(t, state_, actuated(), conditionsAt(time()), effect_states_.data());
}

template class Simulation<double>;
template class Simulation<Jet>;

Eigen::MatrixXd meanInputs(const Dynamics<double>& dynamics, const InputSequence& inputs,
                           const std::vector<double>& times) {
  dynamics.requireThrusters(inputs.thruster_count);
  const int count = inputs.thruster_count;
  Eigen::MatrixXd means = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(times.size()) - 1, count + 1);
  Stepping stepping(inputs, times.front(), dynamics.inputDelay(), false, kDefaultStep);
  std::vector<double> states = dynamics.initialStates();
  for (const Stepping::Held& held : stepping.before(dynamics.settling()))
    dynamics.settle(held.t, {}, inputs.thrusters[held.command],
                    {inputs.lift[held.command], inputs.battery.at(held.time)}, held.duration, states.data());
  Stretch stretch;
  for (Eigen::Index i = 0; i < means.rows(); ++i) {
    const double from = stepping.time(), to = times[static_cast<std::size_t>(i) + 1];
    while (stepping.next(to, stretch)) {
      const Conditions<double> given = stepping.conditionsAt(stepping.time());
      for (int step = 0; step < stretch.steps; ++step) {
        const StepInputs<double> acting =
            dynamics.actuate(stepping.thrusters(), given, stretch.h, states.data());
        const auto& at = acting.thrusters;
        for (int c = 0; c < count; ++c)
          means(i, c) += stretch.h * (acting.held ? at[0](c) : (at[0](c) + 4 * at[1](c) + at[2](c)) / 6);
        means(i, count) += stretch.h * stepping.lift();
      }
    }
    if (to > from) means.row(i) /= to - from;
  }
  return means;
}

}  // namespace ground
