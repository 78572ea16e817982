#pragma once

#include <string>

#include "ground/control/reference_trajectory.h"
#include "ground/model/model.h"
#include "ground/safety/room.h"

namespace ground {

/// Why a craft cannot follow a reference exactly; empty if it can.
///
/// Without effects the craft is differentially flat: its path determines its inputs. By the sway
/// equation of (2.4) a craft without lateral thrust must head along m p'' + Y_v p', or against it
/// if its thrusters also push backwards. Thrust X, yaw rate and yaw moment N follow, and all
/// thrusters must stay within their ranges: for the pair X > 0 and |N| <= l min(X, 2 k input_max -
/// X), for others what Allocation finds. A craft that pushes to both sides may head anywhere: for
/// it, only the size of the thrust is compared with the largest one. The message names the worst
/// instant, and the required and available thrust or moment.
std::string infeasibility(const ReferenceTrajectory& reference, const Model& model);

/// Why a craft on a reference could not be stopped inside a room, with its margin, if the mocap
/// were lost for Fence::kLoss; empty if it could. Throws std::invalid_argument on an invalid room.
std::string leavesRoom(const ReferenceTrajectory& reference, const Room& room);
/// The same for a reference by its parameters, with the largest size that fits if its kind has one.
std::string leavesRoom(const ReferenceParams& params, const ReferenceTrajectory& reference, const Room& room);

}  // namespace ground
