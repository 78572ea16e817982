#pragma once

#include <vector>

#include "ground/identification/run_data.h"

namespace ground {

/// Simulates windows of a run, each from the measured pose and the given velocity at its start,
/// without correction. Returns the simulated measurement at every sample. `initial_nu` has one row
/// a window. Throws std::invalid_argument if checkRun() refuses the run, a window lies outside it, the
/// numbers of rows differ or a velocity is not finite; std::runtime_error if a motion is not finite.
WindowSimulation predict(const Model& model, const RunData& run, const std::vector<Window>& windows,
                         const Eigen::MatrixX3d& initial_nu);

}  // namespace ground
