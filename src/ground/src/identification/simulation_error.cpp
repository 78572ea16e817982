#include "ground/identification/simulation_error.h"

#include <ceres/tiny_solver.h>

#include <algorithm>
#include <sstream>
#include <stdexcept>

#include "parallel.h"
#include "whitening.h"
#include "window_cost.h"

namespace ground {
namespace {

constexpr int kPass = 8;  // derivatives that a Jet carries

/// True state whose measured pose is the given one; nu is the true velocity. A fixed point, reached
/// in two rounds: offsets of heading and position do not feed back on each other.
template <typename T>
RigidState<T> stateMeasuredAt(const Dynamics<T>& dynamics, const Vector3<double>& measured,
                              const Vector3<T>& nu) {
  RigidState<T> state{measured.cast<T>(), nu};
  for (int i = 0; i < 2; ++i) {
    const Vector3<T> seen = dynamics.measure(state).eta;
    state.eta += measured.cast<T>() - seen;
  }
  return state;
}

/// From an initial velocity at the measured pose, or from an initial pose and velocity. Poses are
/// integrated only if asked for or needed.
template <typename T, class Visit>
void simulateWindow(const Dynamics<T>& dynamics, const RunData& run, const Window& window,
                    const Eigen::Matrix<T, Eigen::Dynamic, 1>& initial, bool with_pose,
                    Visit visit) {
  const double start = run.times[window.first];
  const Vector3<double> measured = run.eta.row(window.first);
  const Vector3<T> nu = initial.template tail<3>();
  const RigidState<T> state = initial.size() == 3 ? stateMeasuredAt(dynamics, measured, nu)
                                                  : RigidState<T>{initial.template head<3>(), nu};
  Simulation<T> simulation(dynamics, run.inputs, state, start);
  if (!with_pose && !dynamics.usesPose()) simulation.forgetPose();
  for (int i = window.first; i <= window.last; ++i) {
    simulation.advance(run.times[i]);
    visit(i - window.first, simulation.measure());
  }
}

/// One window's residuals as a function of its initial state, for ceres::TinySolver.
class InitialCost {
 public:
  using Scalar = double;
  enum { NUM_RESIDUALS = Eigen::Dynamic, NUM_PARAMETERS = Eigen::Dynamic };

  InitialCost(const WindowCost& cost, int parameters) : cost_(cost), parameters_(parameters) {}
  int NumResiduals() const { return cost_.num_residuals(); }
  int NumParameters() const { return parameters_; }

  bool operator()(const double* initial, double* residuals, double* jacobian) const {
    const int rows = NumResiduals();
    Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> by_row(rows,
                                                                                  parameters_);
    double* blocks[] = {by_row.data()};
    if (!cost_.Evaluate(&initial, residuals, jacobian ? blocks : nullptr)) {
      // The solver takes a step back from what is not finite.
      std::fill_n(residuals, rows, kInfinity);
      return false;
    }
    if (jacobian) Eigen::Map<Eigen::MatrixXd>(jacobian, rows, parameters_) = by_row;
    return true;
  }

 private:
  const WindowCost& cost_;
  int parameters_;
};

}  // namespace

void solveInitial(const SimulationError& problem, const Model& model, const Free& nothing,
                  const Robust& robust, int window, Eigen::VectorXd& initial, double tolerance) {
  const WindowCost cost(problem, model, nothing, window, robust);
  const InitialCost function(cost, problem.initialSize());
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
  const int count = static_cast<int>(run.times.size());
  for (int i = 0; i < count; ++i) {
    if (run.times[i] < from || run.times[i] > to) continue;
    if (first >= 0 && run.times[i] - run.times[i - 1] > max_gap) {
      add(first, i - 1);
      first = i;
    } else if (first < 0) {
      first = i;
    } else if (run.times[i] - run.times[first] >= length - 1e-9) {
      add(first, i);
      first = i;
    }
    if (i + 1 == count || run.times[i + 1] > to) add(first, i);
  }
  return windows;
}

SimulationError::SimulationError(std::vector<RunData> runs, std::vector<Window> windows,
                                 Target target)
    : runs_(std::move(runs)), windows_(std::move(windows)), target_(target) {
  if (windows_.empty())
    throw std::invalid_argument("the runs are too short: there is no window to simulate");
  for (RunData& run : runs_) {
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
    sigma_.push_back(sigma);
    if (!(run.noise.minCoeff() > 0))
      throw std::invalid_argument(run.name + ": the noise of poses must be positive");
    if (!(run.disturbance.minCoeff() >= 0))
      throw std::invalid_argument(run.name + ": a disturbance must not be negative");
  }
  for (const Window& w : windows_) {
    if (w.run < 0 || w.run >= static_cast<int>(runs_.size()) || w.first < 0 || w.last <= w.first ||
        w.last >= static_cast<int>(runs_[w.run].times.size()))
      throw std::invalid_argument("a window lies outside its run");
  }
  if (target_ != Target::kPoses) return;
  for (const Window& w : windows_)
    whitening_.emplace_back(runs_[w.run].times, w.first, w.last, runs_[w.run].noise,
                            runs_[w.run].disturbance);
}

SimulationError::~SimulationError() = default;
SimulationError::SimulationError(SimulationError&&) noexcept = default;

bool SimulationError::residuals(const Model& model, const std::vector<double>& coordinates,
                                const std::vector<int>& free, int window,
                                const Eigen::VectorXd& initial, Eigen::VectorXd& residuals,
                                Eigen::MatrixXd* jacobian) const {
  const Window& w = windows_[window];
  const RunData& run = runs_[w.run];
  const bool poses = target_ == Target::kPoses;
  const Vector3<double> weight =
      poses ? Vector3<double>::Ones() : Vector3<double>(sigma_[w.run].cwiseInverse());
  const Eigen::MatrixX3d& measurements = poses ? run.poses : run.nu;
  const int samples = w.last - w.first + 1;
  residuals.resize(3 * samples);
  const auto store = [&](int i, const Vector3<double>& simulated) {
    const Vector3<double> measured = measurements.row(w.first + i);
    residuals.segment<3>(3 * i) = (simulated - measured).cwiseProduct(weight);
  };
  if (!jacobian) {
    const Dynamics<double> dynamics(model, coordinates);
    simulateWindow<double>(
        dynamics, run, w, initial, poses,
        [&](int i, const Measurement<double>& m) { store(i, poses ? m.eta : m.nu); });
    if (poses) whitening_[window].apply(residuals);
    return residuals.allFinite();
  }
  const int columns = static_cast<int>(free.size()) + initialSize();
  jacobian->resize(3 * samples, columns);
  for (int begin = 0; begin < columns; begin += kPass) {
    const int count = std::min(kPass, columns - begin);
    std::vector<Jet> theta(coordinates.begin(), coordinates.end());
    Eigen::Matrix<Jet, Eigen::Dynamic, 1> state = initial.cast<Jet>();
    for (int j = 0; j < count; ++j) {
      const int column = begin + j;
      Jet& seeded = column < static_cast<int>(free.size())
                        ? theta[free[column]]
                        : state(column - static_cast<int>(free.size()));
      seeded.v[j] = 1;
    }
    const Dynamics<Jet> dynamics(model, theta);
    simulateWindow<Jet>(dynamics, run, w, state, poses, [&](int i, const Measurement<Jet>& m) {
      const Vector3<Jet>& seen = poses ? m.eta : m.nu;
      store(i, {seen.x().a, seen.y().a, seen.z().a});
      for (int c = 0; c < 3; ++c)
        jacobian->block(3 * i + c, begin, 1, count) = weight(c) * seen(c).v.head(count).transpose();
    });
  }
  if (poses) {
    whitening_[window].apply(residuals);
    whitening_[window].apply(*jacobian);
  }
  return residuals.allFinite() && jacobian->allFinite();
}

WindowSimulation SimulationError::simulate(const Model& model,
                                           FitOptions::Objective objective) const {
  Free nothing;
  nothing.base = model.coordinates();
  Initials initial = measuredInitials(*this);
  inParallel(windows_.size(), 0, [&](std::size_t w) {
    for (const double delta : lossesOf(objective))
      solveInitial(*this, model, nothing, {delta}, static_cast<int>(w), initial[w]);
  });
  return simulateFrom(model, initial);
}

WindowSimulation SimulationError::simulateFrom(const Model& model,
                                               const std::vector<Eigen::VectorXd>& initial) const {
  WindowSimulation result;
  const Dynamics<double> dynamics(model);
  for (std::size_t w = 0; w < windows_.size(); ++w) {
    const Window& window = windows_[w];
    const int samples = window.last - window.first + 1;
    Eigen::MatrixX3d eta(samples, 3), nu(samples, 3);
    simulateWindow<double>(dynamics, runs_[window.run], window, initial[w], true,
                           [&](int i, const Measurement<double>& m) {
                             eta.row(i) = m.eta;
                             nu.row(i) = m.nu;
                           });
    if (!eta.allFinite() || !nu.allFinite())
      throw std::runtime_error(notFinite(*this, static_cast<int>(w)));
    result.eta.push_back(std::move(eta));
    result.nu.push_back(std::move(nu));
  }
  return result;
}

double SimulationError::logDeviations() const {
  double sum = 0;
  for (const Whitening& whitening : whitening_)
    for (const Vector3<double>& deviation : whitening.deviations())
      sum += deviation.array().log().sum();
  return sum;
}

double SimulationError::objective(const WindowSimulation& simulation) const {
  double sum = 0;
  Eigen::Index samples = 0;
  for (std::size_t w = 0; w < windows_.size(); ++w) {
    const Window& span = windows_[w];
    const Eigen::MatrixX3d error =
        simulation.nu[w] - runs_[span.run].nu.middleRows(span.first, simulation.nu[w].rows());
    sum += (error.cwiseAbs() * sigma_[span.run].cwiseInverse()).sum();
    samples += error.rows();
  }
  return sum / static_cast<double>(samples);
}

}  // namespace ground
