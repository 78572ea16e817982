// The runs of a simulation error, from which windows of all lengths are cut.
#pragma once

#include <vector>

#include "ground/identification/simulation_error.h"

namespace ground {

/// Measurements, a row each.
using Rows3 = Eigen::Matrix<double, Eigen::Dynamic, 3, Eigen::RowMajor>;

struct SimulationError::Data {
  std::vector<RunData> runs;
  std::vector<Vector3<double>> sigma;   ///< standard deviations of u, v, r
  std::vector<Rows3> measured;          ///< measurements of the target: velocities or poses
  std::vector<Vector3<double>> weight;  ///< weight of their errors: 1 / standard deviation
};

}  // namespace ground
