// The runs of a simulation error, from which windows of all lengths are cut.
#pragma once

#include <vector>

#include "ground/identification/simulation_error.h"
#include "window_plans.h"

namespace ground {

struct SimulationError::Data {
  std::vector<RunData> runs;
  std::vector<Vector3<double>> sigma;   ///< standard deviations of u, v, r
  std::vector<detail::Rows3> measured;  ///< measurements of the target: velocities or poses
  std::vector<Vector3<double>> weight;  ///< weight of their errors: 1 / standard deviation
};

}  // namespace ground
