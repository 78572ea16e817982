#pragma once

#include <vector>

#include "ground/identification/run_data.h"

namespace ground {

/// Runs the model through windows of a run, each from the measured pose and the given measured
/// velocity at its start, without correction: what is measured at every sample, by the model.
/// `initial_nu` has one row a window. Throws std::invalid_argument when a window lies outside the
/// run or the numbers of rows differ.
WindowSimulation predict(const Model& model, const RunData& run, const std::vector<Window>& windows,
                         const Eigen::MatrixX3d& initial_nu);

}  // namespace ground
