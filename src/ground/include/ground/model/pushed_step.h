#pragma once

#include "ground/model/dynamics.h"

namespace ground {

/// Largest number of effect states for which estimators and planners reserve memory.
constexpr int kMaxStates = 4;

/// One step of a model with an additional constant acceleration `missing` (body; m/s^2, m/s^2,
/// rad/s^2). Half of its change of velocity acts before the step and half after it.
template <typename T, typename H>
RigidState<T> pushedStep(const Dynamics<T>& dynamics, T t, RigidState<T> state,
                         const StepInputs<T>& inputs, const Vector3<T>& missing, const H& h) {
  const Vector3<T> push = T(h / 2) * missing;
  state.nu += push;
  dynamics.template step<true>(t, state, inputs, h);
  state.nu += push;
  return state;
}

}  // namespace ground
