// Initial states of windows.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "ground/identification/simulation_error.h"
#include "robust_loss.h"

namespace ground::detail {

/// Of each window: u, v, r, or x, y, psi, u, v, r where poses are the target.
using Initials = std::vector<Eigen::VectorXd>;

/// The initial states that were measured.
Initials measuredInitials(const SimulationError& problem);

/// Throws std::invalid_argument unless there is an initial state for each window.
void checkInitials(const SimulationError& problem, const Initials& initial);

/// The initial state of one window that suits the model best, sought from the given one. Ends when
/// a step lowers the cost of a sample by less than `tolerance`.
void solveInitial(const SimulationError& problem, const Model& model,
                  const std::vector<double>& coordinates, const RobustLoss& robust, int window,
                  Eigen::VectorXd& initial, double tolerance = 3e-10);

}  // namespace ground::detail
