#include "ground/identification/prediction.h"

#include <Eigen/LU>
#include <stdexcept>

namespace ground {

RigidState<double> stateSeenAs(const Dynamics<Jet>& dynamics, const Measurement<double>& measured) {
  using Vector6 = Eigen::Matrix<double, 6, 1>;
  RigidState<double> state{measured.eta, measured.nu};
  for (int round = 0; round < 10; ++round) {
    RigidState<Jet> seeded;
    for (int i = 0; i < 3; ++i) {
      seeded.eta(i) = Jet(state.eta(i), i);
      seeded.nu(i) = Jet(state.nu(i), 3 + i);
    }
    const Measurement<Jet> seen = dynamics.measure(seeded);
    Vector6 missing;
    Eigen::Matrix<double, 6, 6> slope;
    for (int i = 0; i < 3; ++i) {
      missing(i) = measured.eta(i) - seen.eta(i).a;
      missing(3 + i) = measured.nu(i) - seen.nu(i).a;
      slope.row(i) = seen.eta(i).v.head<6>();
      slope.row(3 + i) = seen.nu(i).v.head<6>();
    }
    const Vector6 step = slope.partialPivLu().solve(missing);
    if (!step.allFinite()) break;
    state.eta += step.head<3>();
    state.nu += step.tail<3>();
    if (step.cwiseAbs().maxCoeff() < 1e-10) return state;
  }
  throw std::runtime_error("the model has no state that is measured as the recorded one");
}

WindowSimulation predict(const Model& model, const RunData& run, const std::vector<Window>& windows,
                         const Eigen::MatrixX3d& initial_nu) {
  if (initial_nu.rows() != static_cast<Eigen::Index>(windows.size()))
    throw std::invalid_argument("there must be as many initial velocities as windows");
  const Dynamics<double> dynamics(model);
  const Dynamics<Jet> differentiable(model);
  WindowSimulation result;
  for (std::size_t w = 0; w < windows.size(); ++w) {
    const int first = windows[w].first, last = windows[w].last;
    if (first < 0 || last < first || last >= static_cast<int>(run.times.size()))
      throw std::invalid_argument("a window lies outside its run");
    const Measurement<double> start{run.eta.row(first), initial_nu.row(w)};
    Simulation<double> simulation(dynamics, run.inputs, stateSeenAs(differentiable, start),
                                  run.times[first]);
    Eigen::MatrixX3d eta(last - first + 1, 3), nu(last - first + 1, 3);
    for (int i = first; i <= last; ++i) {
      simulation.advance(run.times[i]);
      const Measurement<double> seen = simulation.measure();
      eta.row(i - first) = seen.eta;
      nu.row(i - first) = seen.nu;
    }
    result.eta.push_back(std::move(eta));
    result.nu.push_back(std::move(nu));
  }
  return result;
}

}  // namespace ground
