#include "initial_states.h"

#include <stdexcept>

namespace ground::detail {

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
