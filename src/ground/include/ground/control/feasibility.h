#pragma once

#include <string>

#include "ground/control/reference_trajectory.h"
#include "ground/model/body.h"

namespace ground {

/// Why a craft cannot follow a reference exactly; empty when it can.
///
/// Without effects the craft is differentially flat: its path alone says what it takes. By the sway
/// equation of (2.4) the craft has to head along m p'' + Y_v p', since nothing else can push it
/// sideways; thrust, yaw rate and yaw moment follow. The thrust has to be forward and within both
/// thrusters' bounds together with the moment: |N| <= l min(X, 2 k input_max - X). The message
/// names the worst instant, what it takes there and what there is.
std::string infeasibility(const ReferenceTrajectory& reference, const Body<double>& body);

}  // namespace ground
