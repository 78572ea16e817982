#include "initial_states.h"

#include <ceres/tiny_solver.h>

#include <algorithm>
#include <stdexcept>

#include "window_residuals.h"

namespace ground::detail {
namespace {

/// One window's residuals after the loss as a function of its initial state, for ceres::TinySolver.
class InitialCost {
 public:
  using Scalar = double;
  enum { NUM_RESIDUALS = Eigen::Dynamic, NUM_PARAMETERS = Eigen::Dynamic };

  InitialCost(const SimulationError& problem, const Model& model, const std::vector<double>& coordinates,
              int window, const RobustLoss& robust)
      : problem_(problem), model_(model), coordinates_(coordinates), window_(window), robust_(robust) {}
  int NumResiduals() const {
    const Window& w = problem_.windows()[window_];
    return 3 * (w.last - w.first + 1);
  }
  int NumParameters() const { return problem_.initialSize(); }

  bool operator()(const double* initial, double* residuals, double* jacobian) const {
    const Eigen::Map<const Eigen::VectorXd> state(initial, NumParameters());
    const WindowResiduals found =
        residualsOf(problem_, model_, coordinates_, {}, window_, state, jacobian != nullptr);
    const Eigen::Index rows = found.residuals.size();
    if (!found.finite()) {
      // The solver rejects a step to residuals that are not finite.
      std::fill_n(residuals, rows, kInfinity);
      return false;
    }
    const Eigen::MatrixXd derivatives = found.derivatives();
    Eigen::Map<Eigen::MatrixXd> columns(jacobian, jacobian ? rows : 0, NumParameters());
    for (Eigen::Index i = 0; i < rows; ++i) {
      const double r = found.residuals(i);
      residuals[i] = robust_(r);
      if (jacobian) columns.row(i) = robust_.derivative(r) * derivatives.row(i);
    }
    return true;
  }

 private:
  const SimulationError& problem_;
  const Model& model_;
  const std::vector<double>& coordinates_;
  int window_;
  RobustLoss robust_;
};

}  // namespace

void solveInitial(const SimulationError& problem, const Model& model, const std::vector<double>& coordinates,
                  const RobustLoss& robust, int window, Eigen::VectorXd& initial, double tolerance) {
  const InitialCost function(problem, model, coordinates, window, robust);
  ceres::TinySolver<InitialCost> solver;
  solver.options.function_tolerance = tolerance / 3 * function.NumResiduals();
  solver.Solve(function, &initial);
}

Initials measuredInitials(const SimulationError& problem) {
  Initials initial;
  for (const Window& w : problem.windows()) {
    const RunData& run = problem.runs()[w.run];
    initial.emplace_back(problem.initialSize());
    initial.back().tail<3>() = run.nu.row(w.first);
    if (problem.initialSize() == 6) initial.back().head<3>() = run.eta.row(w.first);
  }
  return initial;
}

void checkInitials(const SimulationError& problem, const Initials& initial) {
  bool fits = initial.size() == problem.windows().size();
  for (const Eigen::VectorXd& state : initial)
    fits = fits && state.size() == problem.initialSize() && state.allFinite();
  if (!fits) throw std::invalid_argument("the initial states are not those of the windows");
}

}  // namespace ground::detail
