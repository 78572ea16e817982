#pragma once

#include "ground/model/dynamics.h"

namespace ground {

/// The true state whose measurement is the given pose and velocity: by Newton's method, for a
/// model may turn and shift what the mocap sees by any amount. Throws std::runtime_error when
/// there is none.
RigidState<double> stateSeenAs(const Dynamics<Jet>& dynamics, const Measurement<double>& measured);

}  // namespace ground
