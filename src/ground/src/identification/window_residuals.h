// Residuals of simulations of windows.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "ground/identification/simulation_error.h"
#include "initial_states.h"
#include "normal_equations.h"

namespace ground::detail {

/// Weighted residuals of one window at coordinates of the model and an initial state; with
/// `derivatives` also their derivatives by the parameters with indices `free` and by the initial
/// state.
WindowResiduals residualsOf(const SimulationError& problem, const Model& model,
                            const std::vector<double>& coordinates, const std::vector<int>& free, int window,
                            const Eigen::VectorXd& initial, bool derivatives);

/// Simulates every window from the given initial states. Throws std::runtime_error if a motion is
/// not finite.
WindowSimulation simulateFrom(const SimulationError& problem, const Model& model, const Initials& initial);

}  // namespace ground::detail
