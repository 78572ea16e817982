#include "descent.h"

#include <ceres/ceres.h>

#include <Eigen/QR>
#include <algorithm>
#include <cmath>

#include "dense_algebra.h"
#include "window_costs.h"

namespace ground::detail {
namespace {

/// Relative change of the cost at which the last descent ends: in general, and with
/// FitOptions::near, where comparisons of fits need no finer tolerance.
constexpr double kFineTolerance = 1e-8, kNearTolerance = 1e-6;

/// How often a parameter may be released from its bound, so that the search cannot cycle.
constexpr int kMaxReleases = 5;

/// Largest relative rise of the cost for parameters without information to keep their start.
constexpr double kMaxRise = 0.01;

double fineTolerance(const FitOptions& options) { return options.near ? kNearTolerance : kFineTolerance; }

/// Ends a solve when a parameter has reached a bound.
class AtBound : public ceres::IterationCallback {
 public:
  AtBound(const Free& free, const std::vector<double>& scaled) : free_(free), scaled_(scaled) {}

  ceres::CallbackReturnType operator()(const ceres::IterationSummary& summary) override {
    if (summary.iteration == 0 || !summary.step_is_successful) return ceres::SOLVER_CONTINUE;
    for (std::size_t i = 0; i < scaled_.size(); ++i)
      if (free_.inward(i, scaled_[i]) != 0) return ceres::SOLVER_TERMINATE_SUCCESSFULLY;
    return ceres::SOLVER_CONTINUE;
  }

 private:
  const Free& free_;
  const std::vector<double>& scaled_;
};

/// One solve by ceres; `scaled` and `initial` are start and result. With `until_bound` it ends when
/// a parameter reaches a bound.
ceres::Solver::Summary solve(Linearisation& windows, const Free& free, const RobustLoss& robust,
                             double tolerance, int iterations, bool until_bound, std::vector<double>& scaled,
                             Initials& initial) {
  WindowCosts costs(windows, free, robust, scaled, initial);
  ceres::Solver::Options options;
#if CERES_VERSION_MAJOR >= 2
  ceres::Problem::Options problem_options;
  problem_options.evaluation_callback = &costs;
  ceres::Problem ceres_problem(problem_options);
#else
  ceres::Problem ceres_problem;
  options.evaluation_callback = &costs;
#endif
  costs.addTo(ceres_problem);
  for (std::size_t i = 0; i < scaled.size(); ++i) {
    const int at = static_cast<int>(i);
    if (std::isfinite(free.lower[i]))
      ceres_problem.SetParameterLowerBound(scaled.data(), at, free.lower[i] / free.scale[i]);
    if (std::isfinite(free.upper[i]))
      ceres_problem.SetParameterUpperBound(scaled.data(), at, free.upper[i] / free.scale[i]);
  }
  options.linear_solver_type = ceres::DENSE_SCHUR;
  options.max_num_iterations = iterations;
  // Steps are cut at the bounds; a line search along each would cost as much as the steps.
  options.max_num_line_search_step_size_iterations = 0;
  options.function_tolerance = tolerance;
  options.parameter_tolerance = 1e-10;
  options.gradient_tolerance = 1e-12;
  options.logging_type = ceres::SILENT;
  AtBound at_bound(free, scaled);
  if (until_bound) {
    options.callbacks.push_back(&at_bound);
    options.update_state_every_iteration = true;
  }
  ceres::Solver::Summary summary;
  ceres::Solve(options, &ceres_problem, &summary);
  return summary;
}

/// Derivatives of the cost by the scaled free parameters.
Eigen::VectorXd gradient(Linearisation& windows, const Free& free, const RobustLoss& robust,
                         const Solution& at) {
  const auto n = static_cast<Eigen::Index>(free.index.size());
  std::vector<Eigen::VectorXd> slopes(at.initial.size(), Eigen::VectorXd::Zero(n));
  windows.normalEquations(
      {free.coordinates(at.scaled.data()), free.index, at.initial}, robust.weighing(), [](int) { return 1; },
      [&](int window, int, const NormalEquations& equations) {
        const Eigen::VectorXd slope = equations.b.head(n);
        if (slope.allFinite()) slopes[window] = slope;
      });
  Eigen::VectorXd sum = Eigen::VectorXd::Zero(n);
  for (const Eigen::VectorXd& slope : slopes) sum += slope;
  return sum.cwiseProduct(Eigen::Map<const Eigen::VectorXd>(free.scale.data(), n));
}

/// Whether parameter i is on one of its bounds.
bool onBound(const Free& free, const Solution& at, std::size_t i) {
  return free.inward(i, at.scaled[i]) != 0;
}

/// Whether the cost decreases from the bound of parameter i into its range.
bool fallsInwards(const Eigen::VectorXd& slope, const Free& free, const Solution& at, std::size_t i) {
  return slope(i) * free.inward(i, at.scaled[i]) < -1e-6 * (1e-6 + at.cost);
}

/// The free parameters that are not held; the held ones have the values of a solution.
Free moving(const Free& free, const std::vector<bool>& held, const Solution& at) {
  Free result;
  result.base = free.coordinates(at.scaled.data());
  for (std::size_t i = 0; i < held.size(); ++i) {
    if (held[i]) continue;
    result.index.push_back(free.index[i]);
    result.scale.push_back(free.scale[i]);
    result.lower.push_back(free.lower[i]);
    result.upper.push_back(free.upper[i]);
  }
  return result;
}

/// One solve from a solution, in which the `held` parameters are constant.
void solveBeside(const std::vector<bool>& held, Linearisation& windows, const Free& free,
                 const RobustLoss& robust, double tolerance, const FitOptions& options, Solution& solution) {
  const Free others = moving(free, held, solution);
  std::vector<double> scaled;
  for (std::size_t i = 0; i < held.size(); ++i)
    if (!held[i]) scaled.push_back(solution.scaled[i]);
  const auto summary = solve(windows, others, robust, tolerance, options.max_iterations, options.near, scaled,
                             solution.initial);
  solution.cost = summary.final_cost;
  solution.iterations += static_cast<int>(summary.iterations.size());
  solution.usable = summary.IsSolutionUsable() && std::isfinite(summary.final_cost);
  solution.converged =
      summary.termination_type == ceres::CONVERGENCE || summary.termination_type == ceres::USER_SUCCESS;
  solution.message = summary.message;
  if (!solution.usable) return;
  for (std::size_t i = 0, j = 0; i < held.size(); ++i)
    if (!held[i]) solution.scaled[i] = scaled[j++];
}

/// The parameters to hold at first: the fixed ones, and with `near` those on a bound from which the
/// cost does not decrease inwards.
std::vector<bool> heldAtFirst(Linearisation& windows, const Free& free, const RobustLoss& robust, bool near,
                              const std::vector<bool>& fixed, Solution& solution) {
  std::vector<bool> held = fixed;
  for (std::size_t i = 0; near && i < held.size(); ++i) held[i] = fixed[i] || onBound(free, solution, i);
  if (held == fixed) return held;
  solution.cost = 0;
  const Eigen::VectorXd slope = gradient(windows, free, robust, solution);
  for (std::size_t i = 0; i < held.size(); ++i)
    held[i] = fixed[i] || (held[i] && !fallsInwards(slope, free, solution, i));
  return held;
}

/// Holds the parameters that have reached a bound; returns whether there are any.
bool holdOnBounds(const Free& free, const Solution& solution, std::vector<bool>& held) {
  bool changed = false;
  for (std::size_t i = 0; i < held.size(); ++i)
    if (!held[i] && onBound(free, solution, i)) changed = held[i] = true;
  return changed;
}

/// Descends by one loss with an active set of bounds. In front of a bound the solver's steps
/// shorten to zero for all parameters. Parameters at a bound are therefore held while the others
/// continue, and are released if the cost decreases inwards. `fixed` parameters are constant.
void descendWithinBounds(Linearisation& windows, const Free& free, const RobustLoss& robust, double tolerance,
                         const FitOptions& options, Solution& solution, std::vector<bool> fixed = {}) {
  const std::size_t n = free.index.size();
  fixed.resize(n, false);
  std::vector<bool> held = heldAtFirst(windows, free, robust, options.near, fixed, solution);
  std::vector<int> releases(n, 0);
  while (true) {
    solveBeside(held, windows, free, robust, tolerance, options, solution);
    if (!solution.usable) return;
    if (holdOnBounds(free, solution, held)) continue;
    if (held == fixed) return;
    bool changed = false;
    const Eigen::VectorXd slope = gradient(windows, free, robust, solution);
    for (std::size_t i = 0; i < n; ++i) {
      if (!held[i] || fixed[i] || releases[i] == kMaxReleases) continue;
      if (!fallsInwards(slope, free, solution, i)) continue;
      held[i] = false;
      changed = true;
      ++releases[i];
    }
    if (!changed) return;
  }
}

}  // namespace

std::vector<double> lossesOf(FitOptions::Objective objective) {
  if (objective == FitOptions::Objective::kLeastSquares) return {kInfinity};
  return {kInfinity, 1.0, 0.3, 0.1, 0.03, 0.01};
}

Solution descend(Linearisation& windows, const Free& free, const std::vector<double>& losses,
                 const FitOptions& options, std::vector<double> scaled, Initials initial, double coarse) {
  Solution solution;
  solution.scaled = std::move(scaled);
  solution.initial = std::move(initial);
  for (const double delta : losses) {
    solution.delta = delta;
    const bool last = delta == losses.back() && std::isfinite(delta);
    descendWithinBounds(windows, free, {delta}, last ? fineTolerance(options) : coarse, options, solution);
    if (!solution.usable) break;
  }
  return solution;
}

Solution startKept(Linearisation& windows, const Free& free, const Eigen::MatrixXd& unseen,
                   const FitOptions& options, const Solution& found) {
  const auto n = static_cast<Eigen::Index>(free.index.size());
  const Eigen::ColPivHouseholderQR<Eigen::MatrixXd> pivoted(unseen.transpose());
  const Eigen::Index count = pivoted.rank();
  Eigen::VectorXd way = Eigen::VectorXd::Zero(count);
  Eigen::MatrixXd along(count, unseen.cols());
  std::vector<bool> fixed(static_cast<std::size_t>(n), false);
  for (Eigen::Index j = 0; j < count; ++j) {
    const Eigen::Index i = pivoted.colsPermutation().indices()(j);
    fixed[i] = true;
    way(j) = free.base[free.index[i]] / free.scale[i] - found.scaled[i];
    along.row(j) = unseen.row(i);
  }
  if (way.isZero(0)) return found;
  const Eigen::VectorXd moved = unseen * leastSquares(along, way);
  Solution kept = found;
  for (Eigen::Index i = 0; i < n; ++i) {
    const double start = free.base[free.index[i]] / free.scale[i];
    kept.scaled[i] = fixed[i] ? start
                              : std::clamp(found.scaled[i] + moved(i), free.lower[i] / free.scale[i],
                                           free.upper[i] / free.scale[i]);
  }
  descendWithinBounds(windows, free, {found.delta}, fineTolerance(options), options, kept, fixed);
  const double rounding = 1e-12 * static_cast<double>(windows.problem().windows().size());
  return kept.usable && kept.cost <= (1 + kMaxRise) * found.cost + rounding ? kept : found;
}

}  // namespace ground::detail
