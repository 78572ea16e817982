// Initial states of windows.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "ground/identification/simulation_error.h"
#include "robust_loss.h"

namespace ground::detail {

/// Initial state of each window: u, v, r, or x, y, psi, u, v, r if poses are the target.
using Initials = std::vector<Eigen::VectorXd>;

/// The measured initial states.
Initials measuredInitials(const SimulationError& problem);

/// Throws std::invalid_argument unless there is an initial state for each window.
void checkInitials(const SimulationError& problem, const Initials& initial);

/// Fits the initial state of one window, starting from `initial`. Ends when a step lowers the cost
/// per sample by less than `tolerance`.
void solveInitial(const SimulationError& problem, const Model& model, const std::vector<double>& coordinates,
                  const RobustLoss& robust, int window, Eigen::VectorXd& initial, double tolerance = 3e-10);

}  // namespace ground::detail
