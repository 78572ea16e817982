// What windows of all lengths are cut from.
#pragma once

#include <vector>

#include "ground/identification/simulation_error.h"
#include "window_plans.h"

namespace ground {

struct SimulationError::Data {
  std::vector<RunData> runs;
  std::vector<Vector3<double>> sigma;   ///< standard deviations of u, v, r
  std::vector<detail::Rows3> measured;  ///< what each run's simulations are compared with
  std::vector<Vector3<double>> weight;  ///< of their errors: one over the standard deviations
};

}  // namespace ground
