// Residuals of simulations of windows.
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "ground/identification/simulation_error.h"
#include "normal_equations.h"

namespace ground {

/// Measurements, a row each.
using Rows3 = Eigen::Matrix<double, Eigen::Dynamic, 3, Eigen::RowMajor>;

/// The runs of a simulation error, from which windows of all lengths are cut.
struct SimulationError::Data {
  std::vector<RunData> runs;
  std::vector<Vector3<double>> sigma;   ///< standard deviations of u, v, r
  std::vector<Rows3> measured;          ///< measurements of the target: velocities or poses
  std::vector<Vector3<double>> weight;  ///< weight of their errors: 1 / standard deviation
};

namespace detail {

/// checkRun() for estimators that take no known wrench.
void checkFree(const RunData& run);
/// Error message for a window in which the motion of a model is not finite.
std::string notFinite(const RunData& run, const Window& window);

/// Initial state of each window: u, v, r, or x, y, psi, u, v, r if poses are the target.
using Initials = std::vector<Eigen::VectorXd>;

/// The measured initial states.
Initials measuredInitials(const SimulationError& problem);

/// Weighted residuals of one window at coordinates of the model and an initial state; with
/// `derivatives` also their derivatives by the parameters with indices `free` and by the initial
/// state.
WindowResiduals residualsOf(const SimulationError& problem, const Model& model,
                            const std::vector<double>& coordinates, const std::vector<int>& free, int window,
                            const Eigen::VectorXd& initial, bool derivatives);

/// Adds the simulated measurements of a window from a true state at its start. Throws std::runtime_error if
/// its motion is not finite.
void addSimulated(const RunData& run, const Window& window, const Dynamics<double>& dynamics,
                  const RigidState<double>& start, WindowSimulation& windows);

/// Simulates every window from the given initial states. Throws std::runtime_error if a motion is
/// not finite.
WindowSimulation simulateFrom(const SimulationError& problem, const Model& model, const Initials& initial);

}  // namespace detail
}  // namespace ground
