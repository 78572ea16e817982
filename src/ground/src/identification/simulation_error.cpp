#include "ground/identification/simulation_error.h"

#include <ceres/tiny_solver.h>

#include <algorithm>
#include <sstream>
#include <stdexcept>

#include "descent.h"
#include "linearisation.h"
#include "parallel.h"
#include "window_plans.h"

namespace ground {
namespace {

/// One window's residuals after the loss as a function of its initial state, for ceres::TinySolver.
class InitialCost {
 public:
  using Scalar = double;
  enum { NUM_RESIDUALS = Eigen::Dynamic, NUM_PARAMETERS = Eigen::Dynamic };

  InitialCost(const SimulationError& problem, const Model& model,
              const std::vector<double>& coordinates, int window, const Robust& robust)
      : problem_(problem),
        model_(model),
        coordinates_(coordinates),
        window_(window),
        robust_(robust) {}
  int NumResiduals() const {
    const Window& w = problem_.windows()[window_];
    return 3 * (w.last - w.first + 1);
  }
  int NumParameters() const { return problem_.initialSize(); }

  bool operator()(const double* initial, double* residuals, double* jacobian) const {
    const Eigen::Map<const Eigen::VectorXd> state(initial, NumParameters());
    const WindowResiduals found =
        problem_.residuals(model_, coordinates_, {}, window_, state, jacobian != nullptr);
    const Eigen::Index rows = found.residuals.size();
    if (!found.finite) {
      // The solver takes a step back from what is not finite.
      std::fill_n(residuals, rows, kInfinity);
      return false;
    }
    Eigen::Map<Eigen::MatrixXd> columns(jacobian, jacobian ? rows : 0, NumParameters());
    for (Eigen::Index i = 0; i < rows; ++i) {
      const double r = found.residuals(i);
      residuals[i] = robust_(r);
      if (jacobian)
        columns.row(i) = robust_.derivative(r) * found.derivatives.row(i).head(NumParameters());
    }
    return true;
  }

 private:
  const SimulationError& problem_;
  const Model& model_;
  const std::vector<double>& coordinates_;
  int window_;
  Robust robust_;
};

}  // namespace

void solveInitial(const SimulationError& problem, const Model& model,
                  const std::vector<double>& coordinates, const Robust& robust, int window,
                  Eigen::VectorXd& initial, double tolerance) {
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

std::string notFinite(const SimulationError& problem, int window) {
  const Window& w = problem.windows()[window];
  const RunData& run = problem.runs()[w.run];
  std::ostringstream out;
  out << "the model's motion is not finite in " << run.name << " from " << run.times[w.first]
      << " to " << run.times[w.last] << " s";
  return out.str();
}

std::vector<Window> cutWindows(const RunData& run, int run_index, double from, double to,
                               double length, double max_gap) {
  if (!(length > 0)) throw std::invalid_argument("the length of windows must be positive");
  constexpr int kFewest = 6;  // samples that say something about an initial velocity
  std::vector<Window> windows;
  const auto add = [&](int first, int last) {
    const double duration = run.times[last] - run.times[first];
    if (last - first + 1 >= kFewest && duration > 0.5 * length)
      windows.push_back({run_index, first, last});
  };
  int first = -1;
  const auto begin = std::lower_bound(run.times.begin(), run.times.end(), from);
  const auto end = std::upper_bound(begin, run.times.end(), to);
  const int count = static_cast<int>(end - run.times.begin());
  for (int i = static_cast<int>(begin - run.times.begin()); i < count; ++i) {
    if (first >= 0 && run.times[i] - run.times[i - 1] > max_gap) {
      add(first, i - 1);
      first = i;
    } else if (first < 0) {
      first = i;
    } else if (run.times[i] - run.times[first] >= length - 1e-9) {
      add(first, i);
      first = i;
    }
    if (i + 1 == count) add(first, i);
  }
  return windows;
}

std::shared_ptr<const SimulationError::Data> SimulationError::prepare(std::vector<RunData> runs,
                                                                      Target target) {
  auto data = std::make_shared<Data>();
  for (RunData& run : runs) {
    if (run.poses.rows() == 0) run.poses = run.eta;
    const auto count = static_cast<Eigen::Index>(run.times.size());
    if (run.eta.rows() != count || run.nu.rows() != count || run.poses.rows() != count)
      throw std::invalid_argument(run.name + ": times, eta, nu and poses differ in length");
    if (!run.eta.allFinite() || !run.nu.allFinite() || !run.poses.allFinite())
      throw std::invalid_argument(run.name + ": a measurement is not finite");
    const Vector3<double> mean = run.nu.colwise().mean();
    const Vector3<double> sigma =
        (run.nu.rowwise() - mean.transpose()).array().square().colwise().mean().sqrt();
    if (!(sigma.minCoeff() > 0))
      throw std::invalid_argument(run.name + ": the craft does not move");
    data->sigma.push_back(sigma);
    data->measured.push_back(target == Target::kPoses ? run.poses : run.nu);
    data->weight.push_back((target == Target::kPoses ? run.noise : sigma).cwiseInverse());
    if (!(run.noise.minCoeff() > 0))
      throw std::invalid_argument(run.name + ": the noise of poses must be positive");
  }
  data->runs = std::move(runs);
  return data;
}

SimulationError::SimulationError(std::vector<RunData> runs, std::vector<Window> windows,
                                 Target target)
    : SimulationError(prepare(std::move(runs), target), std::move(windows), target) {}

SimulationError::SimulationError(std::shared_ptr<const Data> data, std::vector<Window> windows,
                                 Target target)
    : data_(std::move(data)),
      windows_(std::move(windows)),
      target_(target),
      plans_(std::make_unique<WindowPlans>()) {
  if (windows_.empty())
    throw std::invalid_argument("the runs are too short: there is no window to simulate");
  for (const Window& w : windows_) {
    if (w.run < 0 || w.run >= static_cast<int>(runs().size()) || w.first < 0 || w.last <= w.first ||
        w.last >= static_cast<int>(runs()[w.run].times.size()))
      throw std::invalid_argument("a window lies outside its run");
  }
}

SimulationError::~SimulationError() = default;
SimulationError::SimulationError(SimulationError&&) noexcept = default;

WindowSimulation SimulationError::simulate(const Model& model,
                                           FitOptions::Objective objective) const {
  const std::vector<double> coordinates = model.coordinates();
  Initials initial = measuredInitials(*this);
  inParallel(windows_.size(), 0, [&](std::size_t w) {
    for (const double delta : lossesOf(objective))
      solveInitial(*this, model, coordinates, {delta}, static_cast<int>(w), initial[w]);
  });
  return simulateFrom(model, initial);
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

double SimulationError::objective(const Model& model,
                                  const std::vector<Eigen::VectorXd>& initial) const {
  if (target_ != Target::kVelocities) return objective(simulateFrom(model, initial));
  const auto sizes = [](const double* residuals, int count, double*, double*, double* loss) {
    for (int i = 0; i < count; ++i) loss[i] = std::abs(residuals[i]);
  };
  const std::vector<double> sums =
      Linearisation(*this, model, 1).losses({model.coordinates(), {}, initial}, sizes);
  double sum = 0;
  int samples = 0;
  for (std::size_t w = 0; w < windows_.size(); ++w) {
    if (!std::isfinite(sums[w])) throw std::runtime_error(notFinite(*this, static_cast<int>(w)));
    sum += sums[w];
    samples += windows_[w].last - windows_[w].first + 1;
  }
  return sum / samples;
}

}  // namespace ground
