// Initial states of windows.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "ground/identification/simulation_error.h"

namespace ground::detail {

/// Initial state of each window: u, v, r, or x, y, psi, u, v, r if poses are the target.
using Initials = std::vector<Eigen::VectorXd>;

/// The measured initial states.
Initials measuredInitials(const SimulationError& problem);

/// Throws std::invalid_argument unless there is an initial state for each window.
void checkInitials(const SimulationError& problem, const Initials& initial);

}  // namespace ground::detail
