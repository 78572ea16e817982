#pragma once

#include "ground/safety/fence.h"

namespace ground {

/// Walls that a plan avoids: a penalty on states from which the craft would come to rest too close
/// to a wall if thrust and lift were cut.
struct PlanWalls {
  Fence fence;
  double age = 0;       ///< age of the state at the cut: duration of a loss of the mocap [s]
  double weight = 100;  ///< weight of the square of Fence::violation
};

}  // namespace ground
