#include <ceres/ceres.h>

#include <Eigen/Eigenvalues>
#include <Eigen/QR>
#include <algorithm>
#include <boost/math/distributions/students_t.hpp>
#include <cmath>
#include <memory>
#include <numeric>
#include <random>
#include <stdexcept>

#include "descent.h"
#include "linearisation.h"
#include "parallel.h"
#include "uncertainty.h"
#include "window_costs.h"

namespace ground {
namespace {

constexpr double kBrief = 0.3;       // windows so short are fitted first [s]
constexpr std::size_t kEnough = 64;  // of them to come near, spread over the data

constexpr int kPatience =
    5;  // times that a parameter is let go from its bound: no going in circles

/// Relative change of the cost at which a descent ends: rough to come near, coarse where another
/// one follows. An exact fit has no use for the fine one, its cost falls until nothing is left of
/// it.
constexpr double kRough = 5e-2, kCoarse = 1e-5, kFine = 1e-8;
/// From near by the last step is the smallest, and fits that are compared need not agree further.
constexpr double kNear = 1e-6;
/// Cost of a sample that initial states may leave to the fit that follows.
constexpr double kRoughly = 1e-4;
/// Relative rise of the cost that values without information may cost for keeping their start.
constexpr double kMaxRise = 0.01;

/// Ends a solve when a parameter has come to a bound.
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

/// One solve; `scaled` and `initial` are start and result. From near it ends at
/// the first bound that is met (`until_bound`).
ceres::Solver::Summary solve(Linearisation& windows, const Free& free, const Robust& robust,
                             double tolerance, int iterations, bool until_bound,
                             std::vector<double>& scaled, Initials& initial) {
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
  // Steps are cut off at the bounds; to search along each would cost as much as the steps do.
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

/// Where a descent ended.
struct Solution {
  std::vector<double> scaled;
  Initials initial;
  double delta = kInfinity;  ///< of the last loss
  double cost = kInfinity;
  int iterations = 0;
  bool usable = false, converged = false;
  std::string message;
};

/// Derivatives of the cost by the scaled free parameters.
Eigen::VectorXd gradient(Linearisation& windows, const Free& free, const Robust& robust,
                         const Solution& at) {
  const auto n = static_cast<Eigen::Index>(free.index.size());
  std::vector<Eigen::VectorXd> slopes(at.initial.size(), Eigen::VectorXd::Zero(n));
  windows.normalEquations(
      {free.coordinates(at.scaled.data()), free.index, at.initial}, robust.weighing(),
      [](int) { return 1; },
      [&](int window, int, const NormalEquations& equations) {
        const Eigen::VectorXd slope = equations.b.head(n);
        if (slope.allFinite()) slopes[window] = slope;
      });
  Eigen::VectorXd sum = Eigen::VectorXd::Zero(n);
  for (const Eigen::VectorXd& slope : slopes) sum += slope;
  return sum.cwiseProduct(Eigen::Map<const Eigen::VectorXd>(free.scale.data(), n));
}

/// Descends by one loss. The solver's steps shorten to nothing in front of a bound, whatever the
/// other parameters still have to go; so those that have come to a bound are held there while the
/// others go on, and are let go when the cost falls inwards (active set).
/// Parameters that are `fixed` stay where they are.
void descend(Linearisation& windows, const Free& free, const Robust& robust, double tolerance,
             const FitOptions& options, Solution& solution, std::vector<bool> fixed = {}) {
  const std::size_t n = free.index.size();
  fixed.resize(n, false);
  std::vector<bool> held = fixed;
  std::vector<int> let_go(n, 0);
  const auto onBound = [&](std::size_t i) { return free.inward(i, solution.scaled[i]) != 0; };
  /// Whether the cost falls from the bound into the range.
  const auto fallsInwards = [&](const Eigen::VectorXd& slope, std::size_t i) {
    return slope(i) * free.inward(i, solution.scaled[i]) < -1e-6 * (1e-6 + solution.cost);
  };
  if (options.near)
    for (std::size_t i = 0; i < n; ++i) held[i] = fixed[i] || onBound(i);
  if (held != fixed) {
    solution.cost = 0;
    const Eigen::VectorXd slope = gradient(windows, free, robust, solution);
    for (std::size_t i = 0; i < n; ++i) held[i] = fixed[i] || (held[i] && !fallsInwards(slope, i));
  }
  while (true) {
    Free moving;
    moving.base = free.coordinates(solution.scaled.data());
    std::vector<double> scaled;
    for (std::size_t i = 0; i < n; ++i) {
      if (held[i]) continue;
      moving.index.push_back(free.index[i]);
      moving.scale.push_back(free.scale[i]);
      moving.lower.push_back(free.lower[i]);
      moving.upper.push_back(free.upper[i]);
      scaled.push_back(solution.scaled[i]);
    }
    const auto summary = solve(windows, moving, robust, tolerance, options.max_iterations,
                               options.near, scaled, solution.initial);
    solution.cost = summary.final_cost;
    solution.iterations += static_cast<int>(summary.iterations.size());
    solution.usable = summary.IsSolutionUsable() && std::isfinite(summary.final_cost);
    solution.converged = summary.termination_type == ceres::CONVERGENCE ||
                         summary.termination_type == ceres::USER_SUCCESS;
    solution.message = summary.message;
    if (!solution.usable) return;
    bool changed = false;
    for (std::size_t i = 0, j = 0; i < n; ++i) {
      if (held[i]) continue;
      solution.scaled[i] = scaled[j++];
      if (onBound(i)) changed = held[i] = true;
    }
    if (changed) continue;
    if (held == fixed) return;
    const Eigen::VectorXd slope = gradient(windows, free, robust, solution);
    for (std::size_t i = 0; i < n; ++i) {
      if (!held[i] || fixed[i] || let_go[i] == kPatience || !fallsInwards(slope, i)) continue;
      held[i] = false;
      changed = true;
      ++let_go[i];
    }
    if (!changed) return;
  }
}

/// Descends from `scaled` by one loss after the other.
Solution descend(Linearisation& windows, const Free& free, const std::vector<double>& losses,
                 const FitOptions& options, std::vector<double> scaled, Initials initial,
                 double coarse = kCoarse) {
  Solution solution;
  solution.scaled = std::move(scaled);
  solution.initial = std::move(initial);
  for (const double delta : losses) {
    solution.delta = delta;
    const bool last = delta == losses.back() && std::isfinite(delta);
    const double fine = options.near ? kNear : kFine;
    descend(windows, free, {delta}, last ? fine : coarse, options, solution);
    if (!solution.usable) break;
  }
  return solution;
}

/// The same fit with its start along the directions that the data do not see: on its way a descent
/// may have gone any length along them. As many parameters as there are such directions, those
/// that move most along them, are put back to their start, and the others are fitted beside them.
/// Returns what was found where that raises the cost: the data do rule the start out.
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
  const Eigen::VectorXd moved = unseen * along.completeOrthogonalDecomposition().solve(way);
  Solution kept = found;
  for (Eigen::Index i = 0; i < n; ++i) {
    const double start = free.base[free.index[i]] / free.scale[i];
    kept.scaled[i] = fixed[i] ? start
                              : std::clamp(found.scaled[i] + moved(i),
                                           free.lower[i] / free.scale[i],
                                           free.upper[i] / free.scale[i]);
  }
  descend(windows, free, {found.delta}, options.near ? kNear : kFine, options, kept, fixed);
  const double rounding = 1e-12 * static_cast<double>(windows.problem().windows().size());
  return kept.usable && kept.cost <= (1 + kMaxRise) * found.cost + rounding ? kept : found;
}

/// Windows cut into pieces of at most `length` seconds; of many, so many spread over all.
std::vector<Window> piecesOf(const SimulationError& problem, double length, std::size_t most) {
  std::vector<Window> all;
  for (const Window& w : problem.windows()) {
    const RunData& run = problem.runs()[w.run];
    const auto found = cutWindows(run, w.run, run.times[w.first], run.times[w.last], length);
    all.insert(all.end(), found.begin(), found.end());
  }
  if (all.empty()) return problem.windows();
  const std::size_t count = std::min(all.size(), most);
  for (std::size_t i = 0; i < count; ++i) all[i] = all[i * all.size() / count];
  all.resize(count);
  return all;
}

/// The sum of squares with the measured initial states. Throws std::runtime_error when a window's
/// simulation is not finite; the solver would say it on stderr, in its words.
double squaresOf(Linearisation& windows, const Free& free, const std::vector<double>& scaled,
                 bool derivatives) {
  const Initials initial = measuredInitials(windows.problem());
  const std::vector<double> losses = windows.losses(
      {free.coordinates(scaled.data()), free.index, initial}, Robust().weighing(), derivatives);
  for (std::size_t w = 0; w < losses.size(); ++w)
    if (!std::isfinite(losses[w]))
      throw std::runtime_error(notFinite(windows.problem(), static_cast<int>(w)));
  return std::accumulate(losses.begin(), losses.end(), 0.0);
}

/// Values nearer to the data than the given ones, where there are any: those that fit short pieces
/// of the windows. Over a short time a simulation depends little on what came before, and the cost
/// has hardly any minimum but one. Throws std::runtime_error when the given ones cannot be
/// simulated.
std::vector<double> approach(Linearisation& whole, Linearisation& brief, const Free& free,
                             const FitOptions& options, const std::vector<double>& from) {
  const double far = squaresOf(whole, free, from, false);
  const Solution near =
      descend(brief, free, {kInfinity}, options, from, measuredInitials(brief.problem()), kRough);
  try {
    if (near.usable && squaresOf(whole, free, near.scaled, true) < far) return near.scaled;
  } catch (const std::runtime_error&) {
    // what suits short windows need not suit long ones
  }
  return from;
}

/// Initial states to start from at the given values: measured ones, or, where these values are
/// near, those that suit them best, for a model may turn and shift what is measured by any amount.
Initials initialsFor(const SimulationError& problem, const Model& model, const Free& free,
                     const std::vector<double>& scaled, const FitOptions& options) {
  Initials initial = measuredInitials(problem);
  if (!options.near) return initial;
  const std::vector<double> coordinates = free.coordinates(scaled.data());
  const Robust robust{options.width > 0 ? options.width : kInfinity};
  inParallel(initial.size(), options.threads, [&](std::size_t w) {
    solveInitial(problem, model, coordinates, robust, static_cast<int>(w), initial[w], kRoughly);
  });
  return initial;
}

/// The model's own values, then as many others as asked for: positive ones up to ten times smaller
/// or larger, the others as far off as they are typically large.
std::vector<std::vector<double>> startsOf(const Free& free, int count) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> uniform(-1, 1);
  std::vector<std::vector<double>> starts;
  for (int s = 0; s < count; ++s) {
    std::vector<double> scaled(free.index.size());
    for (std::size_t i = 0; i < scaled.size(); ++i) {
      const double given = free.base[free.index[i]] / free.scale[i];
      const double lower = free.lower[i] / free.scale[i], upper = free.upper[i] / free.scale[i];
      const double way = s == 0 ? 0 : uniform(random);
      scaled[i] = s == 0       ? given
                  : lower >= 0 ? std::max(given, 0.1) * std::pow(10, way)
                               : given + way;
      scaled[i] = std::min(std::max(scaled[i], lower), upper);
    }
    starts.push_back(scaled);
  }
  return starts;
}

}  // namespace

FitResult SimulationError::fit(const Model& model, const FitOptions& options) const {
  if (options.free.empty()) throw std::invalid_argument("no parameter is free");
  if (options.starts < 1) throw std::invalid_argument("a fit needs at least one start");
  if (!options.initial.empty()) checkInitials(*this, options.initial);
  const Free free = makeFree(model, options.free);
  const int n = static_cast<int>(free.index.size());
  FitResult result;
  result.model = model;
  Solution best;
  std::vector<double> costs;
  const bool robust = options.objective == FitOptions::Objective::kLeastSquares;
  const std::vector<double> losses = options.near && robust && options.width > 0
                                         ? std::vector<double>{options.width}
                                         : lossesOf(options.objective);
  Linearisation windows(*this, model, options.threads);
  std::unique_ptr<const SimulationError> pieces;
  std::unique_ptr<Linearisation> brief;
  if (!options.near) {
    pieces.reset(new SimulationError(data_, piecesOf(*this, kBrief, kEnough), target_));
    brief = std::make_unique<Linearisation>(*pieces, model, options.threads);
  }
  for (const std::vector<double>& from : startsOf(free, options.starts)) {
    Solution found;
    try {
      const std::vector<double> near =
          brief ? approach(windows, *brief, free, options, from) : from;
      const Initials initial = options.initial.empty()
                                   ? initialsFor(*this, model, free, near, options)
                                   : options.initial;
      found = descend(windows, free, losses, options, near, initial);
      if (!found.usable) throw std::runtime_error(found.message);
    } catch (const std::runtime_error& error) {
      if (!costs.empty()) continue;
      // The start values of the model itself have to work: they are what the user gave.
      throw std::runtime_error(std::string("the fit failed at its start values: ") + error.what());
    }
    if (costs.empty() || found.cost < best.cost) best = found;
    costs.push_back(found.cost);
  }
  result.starts = static_cast<int>(costs.size());
  result.starts_at_best = static_cast<int>(std::count_if(costs.begin(), costs.end(), [&](double c) {
    return c <= best.cost + 1e-4 * std::abs(best.cost) + 1e-12;
  }));
  if (robust && std::isinf(best.delta)) {
    const double delta =
        options.width > 0 ? options.width
                          : 2 * deviationOf(windows.residuals({free.coordinates(best.scaled.data()),
                                                               free.index, best.initial}));
    // An exact fit has no outliers.
    if (delta > 1e-9) {
      const Solution robust = descend(windows, free, {delta}, options, best.scaled, best.initial);
      if (robust.usable) {
        const int before = best.iterations;
        best = robust;
        best.iterations += before;
      }
    }
  }
  Uncertainty u = uncertainty(windows, free, free.coordinates(best.scaled.data()), best.initial,
                              {best.delta}, options.block);
  if (u.unseen.cols() > 0) {
    const std::vector<bool> identified = u.identified;
    best = startKept(windows, free, u.unseen, options, best);
    u = uncertainty(windows, free, free.coordinates(best.scaled.data()), best.initial,
                    {best.delta}, options.block);
    for (int i = 0; i < n; ++i) u.identified[i] = u.identified[i] && identified[i];
  }
  result.width = best.delta;
  result.initial = best.initial;
  result.iterations = best.iterations;
  result.converged = best.converged;
  result.message = best.message;

  const std::vector<double> coordinates = free.coordinates(best.scaled.data());
  const auto infos = model.parameters();
  std::vector<double> values = model.values();
  for (int i = 0; i < n; ++i) {
    const ParameterInfo& info = infos[free.index[i]];
    // On a bound rounding may have taken it outside.
    values[free.index[i]] =
        std::clamp(info.fromCoordinate(coordinates[free.index[i]]), info.lower, info.upper);
  }
  result.model.setValues(values);
  result.objective = objective(result.model, best.initial);

  const Eigen::VectorXd deviation = u.covariance.diagonal().cwiseMax(0).cwiseSqrt();
  result.correlation = Eigen::MatrixXd::Identity(n, n);
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j)
      if (i != j && deviation(i) * deviation(j) > 0)
        result.correlation(i, j) =
            free.sign(i) * free.sign(j) * u.covariance(i, j) / (deviation(i) * deviation(j));
  const Eigen::VectorXd eigen =
      Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(u.information).eigenvalues();
  result.condition = eigen(0) > 0 ? eigen(n - 1) / eigen(0) : kInfinity;
  const boost::math::students_t t(std::max(1, u.blocks - n));
  const double quantile = boost::math::quantile(t, 0.975);
  for (int i = 0; i < n; ++i) {
    const ParameterInfo& info = infos[free.index[i]];
    const double at = coordinates[free.index[i]];
    const double spread = u.identified[i] ? deviation(i) * free.scale[i] : kInfinity;
    const double half = quantile * spread;
    double low = info.lower, high = info.upper;
    if (u.identified[i]) {
      low = info.fromCoordinate(std::max(at - half, free.lower[i]));
      high = info.fromCoordinate(std::min(at + half, free.upper[i]));
      if (low > high) std::swap(low, high);
    }
    const double value = values[free.index[i]];
    const double slope = info.coordinate == Coordinate::kReciprocal ? value * value : 1;
    const double margin = 1e-4 * free.scale[i];
    result.parameters.push_back(
        {info.name, info.unit, model.values()[free.index[i]], value, low, high, slope * spread,
         at - free.lower[i] < margin || free.upper[i] - at < margin, bool(u.identified[i])});
  }
  return result;
}

}  // namespace ground
