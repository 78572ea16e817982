#include "window_residuals.h"

#include <algorithm>
#include <array>
#include <sstream>
#include <stdexcept>

#include "ground/model/measurement.h"

namespace ground::detail {
namespace {

constexpr int kMaxInitial = 6;  // largest size of an initial state

/// True state whose measured pose is the given one; nu is the true velocity. A fixed-point
/// iteration that converges in two rounds, because the position offset depends on the heading but
/// not vice versa.
template <typename T>
RigidState<T> stateMeasuredAt(const Dynamics<T>& dynamics, const Vector3<T>& measured, const Vector3<T>& nu) {
  RigidState<T> state{measured, nu};
  for (int i = 0; i < 2; ++i) {
    const Vector3<T> seen = dynamics.measure(state).eta;
    for (int c = 0; c < 3; ++c) state.eta(c) += measured(c) - seen(c);
  }
  return state;
}

/// The state at a window's start: the measured pose and an initial velocity, or an initial pose and
/// velocity.
template <typename T>
RigidState<T> stateAtStart(const Dynamics<T>& dynamics, const Vector3<T>& measured,
                           const std::array<T, kMaxInitial>& initial, int size) {
  if (size == 3) return stateMeasuredAt<T>(dynamics, measured, {initial[0], initial[1], initial[2]});
  return {{initial[0], initial[1], initial[2]}, {initial[3], initial[4], initial[5]}};
}

/// Parameters and initial state of a simulation, with derivatives by some of them.
template <typename T>
struct Variables {
  std::vector<T> coordinates;
  std::array<T, kMaxInitial> initial;

  explicit Variables(const std::vector<double>& values) : coordinates(values.begin(), values.end()) {
    initial.fill(T(0.0));
  }
  /// Makes the columns of a pass variables; `columns` are the free parameters, then the initial state.
  void seed(const std::vector<int>& free, int columns, int pass) {
    const int count = static_cast<int>(free.size()), begin = kDerivatives * pass;
    for (int column = begin; column < std::min(columns, begin + kDerivatives); ++column)
      (column < count ? coordinates[free[column]] : initial[column - count]).v[column - begin] = 1.0;
  }
};

/// Sets the residuals, and one pass of their derivatives if T has any.
template <typename T>
void simulateWindow(const SimulationError& problem, const SimulationError::Data& data,
                    const Dynamics<T>& dynamics, const Variables<T>& point, int window, int pass,
                    WindowResiduals& result) {
  const Window& span = problem.windows()[window];
  const RunData& run = problem.runs()[span.run];
  const Motion motion = motionOf(run);
  const bool poses = problem.target() == Target::kPoses;
  const Vector3<T> start = run.eta.row(span.first).template cast<T>();
  Simulation<T> simulation(dynamics, run.inputs,
                           stateAtStart(dynamics, start, point.initial, problem.initialSize()),
                           run.times[span.first], dynamics.longestStep(), &motion);
  if (!poses && !dynamics.usesPose()) simulation.forgetPose();
  const bool distorts = dynamics.distorts();
  Measurement<T> now;
  for (int i = span.first, row = 0; i <= span.last; ++i) {
    simulation.advance(run.times[i]);
    if (distorts) now = simulation.measure();
    const RigidState<T>& state = simulation.state();
    const Vector3<T>& seen = poses ? (distorts ? now.eta : state.eta) : (distorts ? now.nu : state.nu);
    for (int c = 0; c < 3; ++c, ++row) {
      const double weight = data.weight[span.run](c);
      result.residuals(row) = (valueOf(seen(c)) - data.measured[span.run](i, c)) * weight;
      if constexpr (!std::is_same_v<T, double>) result.passes[pass][row] = weight * seen(c).v;
    }
  }
}

}  // namespace

WindowResiduals residualsOf(const SimulationError& problem, const Model& model,
                            const std::vector<double>& coordinates, const std::vector<int>& free, int window,
                            const Eigen::VectorXd& initial, bool derivatives) {
  const Window& span = problem.windows()[window];
  const int rows = 3 * (span.last - span.first + 1), size = problem.initialSize();
  const int columns = derivatives ? static_cast<int>(free.size()) + size : 0;
  WindowResiduals result(rows, columns);
  const auto simulate = [&](auto type, int pass) {
    using T = decltype(type);
    Variables<T> point(coordinates);
    for (int i = 0; i < size; ++i) point.initial[i] = T(initial(i));
    if constexpr (!std::is_same_v<T, double>) point.seed(free, columns, pass);
    const Dynamics<T> dynamics(model, point.coordinates, problem.runs()[span.run].payload);
    simulateWindow(problem, problem.data(), dynamics, point, window, pass, result);
  };
  if (!derivatives) simulate(double(), 0);
  for (std::size_t pass = 0; pass < result.passes.size(); ++pass) simulate(Jet(), static_cast<int>(pass));
  return result;
}

void checkFree(const RunData& run) {
  checkRun(run);
  if (run.wrench.rows() > 0) throw std::invalid_argument(run.name + ": only GreyBox takes a known wrench");
}

std::string notFinite(const RunData& run, const Window& window) {
  std::ostringstream out;
  out << "the model's motion is not finite in " << run.name << " from "
      << run.times[static_cast<std::size_t>(window.first)] << " to "
      << run.times[static_cast<std::size_t>(window.last)] << " s";
  return out.str();
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

void addSimulated(const RunData& run, const Window& window, const Dynamics<double>& dynamics,
                  const RigidState<double>& start, WindowSimulation& windows) {
  const Motion measured = motionOf(run);
  const int samples = window.last - window.first + 1;
  Eigen::MatrixX3d eta(samples, 3), nu(samples, 3);
  Simulation<double> simulation(dynamics, run.inputs, start, run.times[window.first], dynamics.longestStep(),
                                &measured);
  for (int i = 0; i < samples; ++i) {
    simulation.advance(run.times[window.first + i]);
    const Measurement<double> seen = simulation.measure();
    eta.row(i) = seen.eta;
    nu.row(i) = seen.nu;
  }
  if (!eta.allFinite() || !nu.allFinite()) throw std::runtime_error(notFinite(run, window));
  windows.eta.push_back(std::move(eta));
  windows.nu.push_back(std::move(nu));
}

WindowSimulation simulateFrom(const SimulationError& problem, const Model& model, const Initials& initial) {
  WindowSimulation result;
  for (std::size_t w = 0; w < problem.windows().size(); ++w) {
    const Window& window = problem.windows()[w];
    const RunData& run = problem.runs()[window.run];
    const Dynamics<double> dynamics(model, run.payload);
    std::array<double, kMaxInitial> from{};
    std::copy(initial[w].begin(), initial[w].end(), from.begin());
    const Vector3<double> pose = run.eta.row(window.first);
    addSimulated(run, window, dynamics, stateAtStart(dynamics, pose, from, problem.initialSize()), result);
  }
  return result;
}

}  // namespace ground::detail

namespace ground {

WindowSimulation predict(const Model& model, const RunData& run, const std::vector<Window>& windows,
                         const Eigen::MatrixX3d& initial_nu) {
  detail::checkFree(run);
  if (initial_nu.rows() != static_cast<Eigen::Index>(windows.size()))
    throw std::invalid_argument("there must be as many initial velocities as windows");
  if (!initial_nu.allFinite()) throw std::invalid_argument("an initial velocity is not finite");
  const Dynamics<double> dynamics(model, run.payload);
  const Dynamics<Jet> differentiable(model, run.payload);
  WindowSimulation result;
  for (std::size_t w = 0; w < windows.size(); ++w) {
    const int first = windows[w].first, last = windows[w].last;
    if (first < 0 || last < first || last >= static_cast<int>(run.times.size()))
      throw std::invalid_argument("a window lies outside its run");
    const Measurement<double> start{run.eta.row(first), initial_nu.row(w)};
    detail::addSimulated(run, windows[w], dynamics, stateSeenAs(differentiable, start), result);
  }
  return result;
}

}  // namespace ground
