#include "ground/model/simulation.h"

namespace ground {
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
                     inputs.thrusters[held.command].template cast<T>(), inputs.lift[held.command],
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
    if (stretch.by_delay == 0)
      step(stretch.steps, stretch.h);
    else
      step(stretch.steps, dynamics_.withDelay(stretch.h, stretch.by_delay));
  }
}

template <typename T>
template <typename H>
void Simulation<T>::step(int steps, const H& h) {
  const Thrusters<T> held = stepping_.thrusters().template cast<T>();
  const auto act = [&] { return dynamics_.actuate(held, stepping_.lift(), T(h), effect_states_.data()); };
  if (!dynamics_.hasMemory()) return dynamics_.step(t_, state_, act(), h, steps, pose_);
  for (int i = 0; i < steps; ++i) dynamics_.step(t_, state_, act(), h, 1, pose_);
}

template <typename T>
Thrusters<T> Simulation<T>::actuated() const {
  std::vector<T> states = effect_states_;
  return dynamics_.actuate(stepping_.thrusters().template cast<T>(), stepping_.lift(), T(0.0), states.data())
      .thrusters[0];
}

template <typename T>
RigidState<T> Simulation<T>::derivative() const {
  T t = t_;
  setValue(t, stepping_.t());
  return dynamics_.derivative(t, state_, actuated(), stepping_.lift(), effect_states_.data());
}

template class Simulation<double>;
template class Simulation<Jet>;

}  // namespace ground
