#pragma once

#include "ground/model/dynamics.h"

namespace ground {

/// The true state whose measurement is the given pose and velocity. Uses Newton's method, because
/// effects may rotate and shift the measurement by any amount. Throws std::runtime_error if there
/// is no such state.
RigidState<double> stateSeenAs(const Dynamics<Jet>& dynamics, const Measurement<double>& measured);

}  // namespace ground
