#pragma once

#include <string>

#include "ground/control/reference_trajectory.h"
#include "ground/model/body.h"

namespace ground {

/// Why a craft cannot follow a reference exactly; empty if it can.
///
/// Without effects the craft is differentially flat: its path determines its inputs. By the sway
/// equation of (2.4) the craft must head along m p'' + Y_v p', because it has no lateral thrust.
/// Thrust X, yaw rate and yaw moment N follow. The thrust must be forward, and both thrusters
/// within their bounds: |N| <= l min(X, 2 k input_max - X). The message names the worst instant,
/// and the required and available thrust or moment.
std::string infeasibility(const ReferenceTrajectory& reference, const Body<double>& body);

}  // namespace ground
