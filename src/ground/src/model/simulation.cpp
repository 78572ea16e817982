#include "ground/model/simulation.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

namespace ground {
namespace {

/// Actuators forget what was commanded longer ago [s].
constexpr double kActuatorMemory = 10.0;

bool isConstant(double) { return true; }
bool isConstant(const Jet& x) { return x.v.isZero(0.0); }

}  // namespace

void InputSequence::add(double time, double left, double right, double lift_value) {
  if (!times.empty() && time < times.back())
    throw std::invalid_argument("commands have to be in ascending order of time");
  times.push_back(time);
  thrusters.emplace_back(left, right);
  lift.push_back(lift_value);
}

template <typename T>
Simulation<T>::Simulation(const Dynamics<T>& dynamics, const InputSequence& inputs,
                          const RigidState<T>& initial, double start, double max_step)
    : dynamics_(dynamics),
      inputs_(inputs),
      state_(initial),
      actuator_states_(dynamics.stateCount(), T(0.0)),
      time_(start),
      max_step_(max_step) {
  const double delay = valueOf(dynamics_.inputDelay());
  const auto at = [&](double time) {
    return std::upper_bound(inputs_.times.begin(), inputs_.times.end(), time - delay) -
           inputs_.times.begin();
  };
  next_ = at(start);
  if (!dynamics_.hasActuators()) return;
  for (std::size_t i = at(start - kActuatorMemory); i < next_; ++i) {
    const T from = T(inputs_.times[i]) + dynamics_.inputDelay();
    const T until = i + 1 < next_ ? T(inputs_.times[i + 1]) + dynamics_.inputDelay() : T(start);
    dynamics_.actuate(inputs_.thrusters[i].template cast<T>(), inputs_.lift[i], until - from,
                      actuator_states_.data());
  }
}

template <typename T>
void Simulation<T>::advance(double time) {
  if (!(time >= valueOf(time_)))
    throw std::invalid_argument("cannot simulate back from " + std::to_string(valueOf(time_)) +
                                " s to " + std::to_string(time) + " s");
  while (next_ < inputs_.size()) {
    const T change = T(inputs_.times[next_]) + dynamics_.inputDelay();
    if (valueOf(change) > time) break;
    advanceHeld(change);
    ++next_;
  }
  advanceHeld(T(time));
}

template <typename T>
void Simulation<T>::advanceHeld(const T& until) {
  const T duration = until - time_;
  // A duration of zero still carries a derivative when the instant moves with the delay.
  const bool constant = isConstant(duration);
  if (valueOf(duration) < 0 || (constant && valueOf(duration) == 0)) return;
  const int steps = std::max(1, static_cast<int>(std::ceil(valueOf(duration) / max_step_ - 1e-9)));
  if (constant) {
    const double h = valueOf(duration) / steps;
    pose_ ? step<true>(steps, h) : step<false>(steps, h);
  } else {
    const T h = duration / double(steps);
    pose_ ? step<true>(steps, h) : step<false>(steps, h);
  }
  time_ = until;
}

template <typename T>
template <bool kPose, typename H>
void Simulation<T>::step(int steps, const H& h) {
  const Vector2<T> held = command();
  StepInputs<T> acting{{held, held, held}, lift(), true};
  T now = time_;
  for (int i = 0; i < steps; ++i) {
    if (dynamics_.hasActuators())
      acting = dynamics_.actuate(held, lift(), T(h), actuator_states_.data());
    state_ = dynamics_.template step<kPose>(now, state_, acting, h);
    now += h;
  }
}

template <typename T>
Vector2<T> Simulation<T>::command() const {
  if (next_ == 0) return Vector2<T>::Zero();
  return inputs_.thrusters[next_ - 1].template cast<T>();
}

template <typename T>
double Simulation<T>::lift() const {
  return next_ == 0 ? 0.0 : inputs_.lift[next_ - 1];
}

template <typename T>
Vector2<T> Simulation<T>::actuated() const {
  std::vector<T> states = actuator_states_;
  return dynamics_.actuate(command(), lift(), T(0.0), states.data()).thrusters[0];
}

template <typename T>
RigidState<T> Simulation<T>::derivative() const {
  return dynamics_.derivative(time_, state_, actuated(), lift());
}

template class Simulation<double>;
template class Simulation<Jet>;

}  // namespace ground
