#pragma once

#include <algorithm>
#include <cmath>

#include "ground/model/dynamics.h"

namespace ground {

/// Largest number of effect states for which estimators and planners reserve memory.
constexpr int kMaxStates = 4;

/// One step of a model with an additional constant acceleration `missing` (body; m/s^2, m/s^2,
/// rad/s^2). Half of its change of velocity acts before the step and half after it.
template <typename T>
RigidState<T> pushedStep(const Dynamics<T>& dynamics, T t, RigidState<T> state, const StepInputs<T>& inputs,
                         const Vector3<T>& missing, double h) {
  const Vector3<T> push = T(h / 2) * missing;
  state.nu += push;
  dynamics.step(t, state, inputs, h);
  state.nu += push;
  return state;
}

/// State after a step of constant commands in which a missing wrench acts, see pushedStep; moves the
/// states of effects, too. Steps that are too long for these (Dynamics::settling) are divided.
template <typename T>
RigidState<T> drivenStep(const Dynamics<T>& dynamics, const T& t, RigidState<T> state,
                         const Thrusters<T>& command, const Conditions<T>& given, const Vector3<T>& missing,
                         double h, T* states) {
  const int parts = std::max(1, static_cast<int>(std::ceil(h / dynamics.settling().step - 1e-9)));
  const double part = h / parts;
  for (int i = 0; i < parts; ++i) {
    const StepInputs<T> acting = dynamics.actuate(command, given, T(part), states);
    state = pushedStep(dynamics, T(t + i * part), state, acting, missing, part);
  }
  return state;
}

}  // namespace ground
