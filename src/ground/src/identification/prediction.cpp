#include "ground/identification/prediction.h"

#include <stdexcept>

#include "checks.h"
#include "ground/model/measurement.h"

namespace ground {

WindowSimulation predict(const Model& model, const RunData& run, const std::vector<Window>& windows,
                         const Eigen::MatrixX3d& initial_nu) {
  detail::checkFree(run);
  if (initial_nu.rows() != static_cast<Eigen::Index>(windows.size()))
    throw std::invalid_argument("there must be as many initial velocities as windows");
  if (!initial_nu.allFinite()) throw std::invalid_argument("an initial velocity is not finite");
  const Dynamics<double> dynamics(model, run.payload);
  const Dynamics<Jet> differentiable(model, run.payload);
  const Motion measured = motionOf(run);
  WindowSimulation result;
  for (std::size_t w = 0; w < windows.size(); ++w) {
    const int first = windows[w].first, last = windows[w].last;
    if (first < 0 || last < first || last >= static_cast<int>(run.times.size()))
      throw std::invalid_argument("a window lies outside its run");
    const Measurement<double> start{run.eta.row(first), initial_nu.row(w)};
    Simulation<double> simulation(dynamics, run.inputs, stateSeenAs(differentiable, start), run.times[first],
                                  dynamics.longestStep(), &measured);
    Eigen::MatrixX3d eta(last - first + 1, 3), nu(last - first + 1, 3);
    for (int i = first; i <= last; ++i) {
      simulation.advance(run.times[i]);
      const Measurement<double> seen = simulation.measure();
      eta.row(i - first) = seen.eta;
      nu.row(i - first) = seen.nu;
    }
    if (!eta.allFinite() || !nu.allFinite()) throw std::runtime_error(detail::notFinite(run, windows[w]));
    result.eta.push_back(std::move(eta));
    result.nu.push_back(std::move(nu));
  }
  return result;
}

}  // namespace ground
