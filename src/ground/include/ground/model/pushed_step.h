#pragma once

#include "ground/model/dynamics.h"

namespace ground {

/// Most states of a model's effects that estimators and planners reserve room for.
constexpr int kMostStates = 4;

/// One step of a model that lacks a constant acceleration (body; m/s^2, m/s^2, rad/s^2): half of it
/// acts before and half after the step.
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
