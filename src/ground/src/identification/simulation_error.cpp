#include "ground/identification/simulation_error.h"

#include <stdexcept>

#include "window_least_squares.h"
#include "window_residuals.h"

namespace ground {

std::shared_ptr<const SimulationError::Data> SimulationError::prepare(std::vector<RunData> runs,
                                                                      Target target) {
  auto data = std::make_shared<Data>();
  for (RunData& run : runs) {
    detail::checkFree(run);
    if (run.poses.rows() == 0) run.poses = run.eta;
    const Vector3<double> mean = run.nu.colwise().mean();
    const Vector3<double> sigma =
        (run.nu.rowwise() - mean.transpose()).array().square().colwise().mean().sqrt();
    if (!(sigma.minCoeff() > 0)) throw std::invalid_argument(run.name + ": the craft does not move");
    data->sigma.push_back(sigma);
    data->measured.push_back(target == Target::kPoses ? run.poses : run.nu);
    data->weight.push_back((target == Target::kPoses ? run.noise : sigma).cwiseInverse());
  }
  data->runs = std::move(runs);
  return data;
}

SimulationError::SimulationError(std::vector<RunData> runs, std::vector<Window> windows, Target target)
    : SimulationError(prepare(std::move(runs), target), std::move(windows), target) {}

SimulationError::SimulationError(std::shared_ptr<const Data> data, std::vector<Window> windows, Target target)
    : data_(std::move(data)), windows_(std::move(windows)), target_(target) {
  if (windows_.empty()) throw std::invalid_argument("the runs are too short: there is no window to simulate");
  for (const Window& w : windows_) {
    if (w.run < 0 || w.run >= static_cast<int>(runs().size()) || w.first < 0 || w.last <= w.first ||
        w.last >= static_cast<int>(runs()[w.run].times.size()))
      throw std::invalid_argument("a window lies outside its run");
  }
}

const Vector3<double>& SimulationError::sigma(int run) const {
  if (run < 0 || run >= static_cast<int>(data_->sigma.size()))
    throw std::out_of_range("there is no such run");
  return data_->sigma[static_cast<std::size_t>(run)];
}
const std::vector<RunData>& SimulationError::runs() const { return data_->runs; }

WindowSimulation SimulationError::simulate(const Model& model, FitOptions::Objective objective) const {
  constexpr double kTolerance = 1e-10;  // relative
  const detail::Linearisation windows(*this, model, 0);
  detail::Free none;
  none.base = model.coordinates();
  detail::Solution found{{}, detail::measuredInitials(*this)};
  for (const double delta : detail::lossesOf(objective))
    found = detail::minimiseLoss(windows, none, delta, kTolerance, FitOptions().max_iterations, found);
  return detail::simulateFrom(*this, model, found.initial);
}

double SimulationError::objective(const WindowSimulation& simulation) const {
  double sum = 0;
  Eigen::Index samples = 0;
  for (std::size_t w = 0; w < windows_.size(); ++w) {
    const Window& span = windows_[w];
    const Eigen::MatrixX3d error =
        simulation.nu[w] - runs()[span.run].nu.middleRows(span.first, simulation.nu[w].rows());
    sum += (error.cwiseAbs() * sigma(span.run).cwiseInverse()).sum();
    samples += error.rows();
  }
  return sum / static_cast<double>(samples);
}

}  // namespace ground
