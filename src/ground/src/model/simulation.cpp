#include "ground/model/simulation.h"

namespace ground {
namespace {

bool isConstant(double) { return true; }
bool isConstant(const Jet& x) { return x.isConstant(); }

}  // namespace

template <typename T>
Simulation<T>::Simulation(const Dynamics<T>& dynamics, const InputSequence& inputs,
                          const RigidState<T>& initial, double start, double max_step,
                          const Motion* measured)
    : dynamics_(dynamics),
      stepping_(inputs, start, valueOf(dynamics.inputDelay()), !isConstant(dynamics.inputDelay()),
                max_step),
      state_(initial),
      effect_states_(dynamics.initialStates()),
      t_(stepping_.t()) {
  dynamics_.requireThrusters(inputs.thruster_count);
  for (const Stepping::Held& held : stepping_.before(dynamics_.settling()))
    dynamics_.settle(T(held.t), measured ? cast<T>(measured->at(held.time)) : state_, inputs.thrusters[held.command].template cast<T>(),
                     inputs.lift[held.command], dynamics_.withDelay(held.duration, held.by_delay),
                     effect_states_.data());
}

template <typename T>
void Simulation<T>::restart(const RigidState<T>& state) {
  state_ = state;
  for (T& own : effect_states_) own = T(valueOf(own));
}

template <typename T>
void Simulation<T>::advance(double time, Rotation<ValueOf<T>> heading) {
  Stretch stretch;
  while (stepping_.next(time, stretch)) {
    valueIn(t_) = stretch.t;
    if (stretch.by_delay == 0) {
      pose_ ? step<true>(stretch.steps, stretch.h, heading)
            : step<false>(stretch.steps, stretch.h, heading);
    } else {
      const T h = dynamics_.withDelay(stretch.h, stretch.by_delay);
      pose_ ? step<true>(stretch.steps, h, heading) : step<false>(stretch.steps, h, heading);
    }
  }
}

template <typename T>
template <bool kPose, typename H>
void Simulation<T>::step(int steps, const H& h, Rotation<ValueOf<T>>& heading) {
  if (!dynamics_.hasMemory()) {
    dynamics_.template hold<kPose>(t_, state_, stepping_.thrusters(), stepping_.lift(), h, steps,
                                   &heading);
    return;
  }
  const Thrusters<T> held = stepping_.thrusters().template cast<T>();
  for (int i = 0; i < steps; ++i)
    dynamics_.template step<kPose>(
        t_, state_, dynamics_.actuate(held, stepping_.lift(), T(h), effect_states_.data()), h, 1,
        &heading);
}

template <typename T>
Thrusters<T> Simulation<T>::actuated() const {
  std::vector<T> states = effect_states_;
  return dynamics_
      .actuate(stepping_.thrusters().template cast<T>(), stepping_.lift(), T(0.0), states.data())
      .thrusters[0];
}

template <typename T>
RigidState<T> Simulation<T>::derivative() const {
  T t = t_;
  valueIn(t) = stepping_.t();
  return dynamics_.derivative(t, state_, actuated(), stepping_.lift(), effect_states_.data());
}

template class Simulation<double>;
template class Simulation<Jet>;

}  // namespace ground
