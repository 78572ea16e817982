// Shared by the effects that turn thrusters.
#pragma once

#include "ground/model/types.h"

namespace ground {

/// Rotation by a parameter [rad] that is usually small, without the library's sine, which would take
/// most of the time of the effects that turn thrusters: they need it at every stage of every step.
template <typename T>
Rotation<T> turnedBy(const T& angle) {
  using V = ValueOf<T>;
  V cosine, sine;
  cosSinBeside(V(1.0), V(0.0), valueOf(angle), valueOf(angle), cosine, sine);
  return Rotation<T>(angle, cosine, sine);
}

}  // namespace ground
