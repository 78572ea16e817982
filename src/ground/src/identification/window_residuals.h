// Residuals of simulations of windows, one by one or in lanes.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "ground/identification/simulation_error.h"
#include "initial_states.h"
#include "normal_equations.h"
#include "window_plans.h"

namespace ground::detail {

/// Weighted residuals of one window at coordinates of the model and an initial state; with
/// `derivatives` also their derivatives by the parameters with indices `free` and by the initial
/// state.
WindowResiduals residualsOf(const SimulationError& problem, const Model& model,
                            const std::vector<double>& coordinates, const std::vector<int>& free,
                            int window, const Eigen::VectorXd& initial, bool derivatives);

/// Simulates every window from the given initial states. Throws std::runtime_error if a motion is
/// not finite.
WindowSimulation simulateFrom(const SimulationError& problem, const Model& model,
                              const Initials& initial);

/// Simulates windows at coordinates of a model. With `derivatives` it also computes derivatives by
/// the parameters with indices `free` and by the initial state. All arguments must outlive it.
class Evaluation {
 public:
  Evaluation(const SimulationError& error, const Model& model,
             const std::vector<double>& coordinates, const std::vector<int>& free,
             bool derivatives);

  /// Groups of windows to simulate in lanes.
  WindowPlans::Groups groups() const;
  /// Simulates one window from its initial state.
  void one(int window, const Eigen::VectorXd& initial, WindowResiduals& result) const;
  /// Simulates a group of windows; `initial` has the initial states of all windows.
  void together(const WindowPlans::Group& group, const std::vector<Eigen::VectorXd>& initial,
                LaneRows& result) const;

 private:
  template <typename V, typename D, class Simulate>
  void inPasses(const Simulate& simulate) const;

  const SimulationError& error_;
  const Model& model_;
  const std::vector<double>& coordinates_;
  const std::vector<int>& free_;
  int columns_;
};

}  // namespace ground::detail
