// The fit by simulation error, step by step.
#include <algorithm>
#include <cmath>
#include <memory>
#include <numeric>
#include <random>
#include <stdexcept>
#include <string>

#include "estimates.h"
#include "linearisation.h"
#include "uncertainty.h"
#include "window_least_squares.h"
#include "window_residuals.h"

namespace ground {
namespace detail {
namespace {

bool isRobust(const FitOptions& options) { return options.objective == FitOptions::Objective::kLeastSquares; }

double toleranceOf(const FitOptions& options) { return options.warm ? kComparable : kFine; }

/// `count` starts, in coordinates over scale: the model's values, then random ones. Non-negative
/// parameters are scaled by a factor of 0.1 to 10; others are shifted by up to their scale.
std::vector<std::vector<double>> startsOf(const Free& free, int count) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> uniform(-1, 1);
  const std::vector<double> given = startOf(free);
  std::vector<std::vector<double>> starts;
  for (int s = 0; s < count; ++s) {
    std::vector<double> scaled = given;
    for (std::size_t i = 0; i < scaled.size(); ++i) {
      const double lower = free.lower[i] / free.scale[i], upper = free.upper[i] / free.scale[i];
      const double way = s == 0 ? 0 : uniform(random);
      if (s > 0) scaled[i] = lower >= 0 ? std::max(given[i], 0.1) * std::pow(10, way) : given[i] + way;
      scaled[i] = std::min(std::max(scaled[i], lower), upper);
    }
    starts.push_back(scaled);
  }
  return starts;
}

/// Short windows, cut from those of a problem and spread evenly over them.
std::vector<Window> shortPieces(const SimulationError& problem) {
  constexpr double kPart = 0.2;       // of the length of a window
  constexpr std::size_t kCount = 64;  // at most; enough for an approximate solution
  std::vector<Window> all;
  for (const Window& w : problem.windows()) {
    const RunData& run = problem.runs()[w.run];
    const auto found =
        cutWindows(run, w.run, run.times[w.first], run.times[w.last], kPart * run.scales.window);
    all.insert(all.end(), found.begin(), found.end());
  }
  if (all.empty()) return problem.windows();
  const std::size_t count = std::min(all.size(), kCount);
  for (std::size_t i = 0; i < count; ++i) all[i] = all[i * all.size() / count];
  all.resize(count);
  return all;
}

/// The sum of squares with the measured initial states. Throws std::runtime_error if a window's is not
/// finite.
double squaresOf(const Linearisation& windows, const Free& free, const std::vector<double>& scaled) {
  const Initials initial = measuredInitials(windows.problem());
  const std::vector<double> losses =
      windows.losses({free.coordinates(scaled.data()), free.index, initial}, RobustLoss().weighing());
  for (std::size_t w = 0; w < losses.size(); ++w) {
    const Window& window = windows.problem().windows()[w];
    if (!std::isfinite(losses[w]))
      throw std::runtime_error(notFinite(windows.problem().runs()[window.run], window));
  }
  return std::accumulate(losses.begin(), losses.end(), 0.0);
}

/// A better start: values fitted to short pieces of the windows, or `from` if these do not lower
/// the cost. Over a short time a simulation depends little on its past, so the cost rarely has more
/// than one minimum. Throws std::runtime_error if the model cannot be simulated at `from`.
std::vector<double> approach(const Linearisation& windows, const SimulationError& pieces, const Free& free,
                             const FitOptions& options, const std::vector<double>& from) {
  const double before = squaresOf(windows, free, from);
  const Linearisation short_windows(pieces, windows.model(), options.threads);
  const Solution found = minimiseLoss(short_windows, free, kInfinity, kApproximate, options.max_iterations,
                                      {from, measuredInitials(pieces)});
  try {
    if (squaresOf(windows, free, found.scaled) < before) return found.scaled;
  } catch (const std::runtime_error&) {
    // Values that fit short windows may diverge over long ones.
  }
  return from;
}

/// Initial states at the start of a fit: those of the options if given. Otherwise fitted ones
/// with FitOptions::warm, because effects may rotate and shift the measurement by any amount, and
/// measured ones without.
Initials initialsAt(const std::vector<double>& scaled, const Linearisation& windows, const Free& free,
                    const FitOptions& options) {
  constexpr double kTolerance = 1e-3;  // relative; the following fit refines them
  if (!options.initial.empty()) return options.initial;
  const Initials measured = measuredInitials(windows.problem());
  if (!options.warm) return measured;
  Free none;
  none.base = free.coordinates(scaled.data());
  const double delta = options.width > 0 ? options.width : kInfinity;
  return minimiseLoss(windows, none, delta, kTolerance, options.max_iterations, {{}, measured}).initial;
}

void checkInitials(const SimulationError& problem, const Initials& initial) {
  bool fits = initial.size() == problem.windows().size();
  for (const Eigen::VectorXd& state : initial)
    fits = fits && state.size() == problem.initialSize() && state.allFinite();
  if (!fits) throw std::invalid_argument("the initial states are not those of the windows");
}

/// The weight of what is known beforehand at the start of a fit, where the residuals are largest: a fit comes
/// from what is known to what the data say.
double weightAtStart(const Linearisation& windows, const Free& free, const FitOptions& options) {
  FitOptions warm = options;
  warm.warm = true;
  const std::vector<double> start = startOf(free);
  const double delta = options.warm && options.width > 0 ? options.width : kInfinity;
  return magnitudeOf(windows, free, {start, initialsAt(start, windows, free, warm), delta});
}

/// Fits from all starts that could be simulated.
struct Fits {
  Solution best;
  std::vector<double> costs;

  /// How many converged to the best cost.
  int atBest() const {
    const double same = best.cost + 1e-4 * std::abs(best.cost) + 1e-12;
    return static_cast<int>(
        std::count_if(costs.begin(), costs.end(), [&](double cost) { return cost <= same; }));
  }
};

/// Fits from every start, after a fit to short pieces if given. Throws std::runtime_error if
/// the fit from the model's values, which the user chose, fails.
Fits fitFromStarts(const Linearisation& windows, const SimulationError* pieces, const Free& free,
                   const FitOptions& options) {
  std::vector<double> losses = lossesOf(options.objective);
  if (options.warm && isRobust(options) && options.width > 0) losses = {options.width};
  Fits result;
  for (const std::vector<double>& start : startsOf(free, options.starts)) {
    Solution found;
    try {
      found.scaled = pieces ? approach(windows, *pieces, free, options, start) : start;
      found.initial = initialsAt(found.scaled, windows, free, options);
      for (const double delta : losses) {
        const bool last = delta == losses.back() && std::isfinite(delta);
        const double tolerance = last ? toleranceOf(options) : options.starts > 1 ? kComparable : kCoarse;
        found = minimiseLoss(windows, free, delta, tolerance, options.max_iterations, found);
        if (!std::isfinite(found.cost)) throw std::runtime_error("the model's motion is not finite");
      }
    } catch (const std::runtime_error& error) {
      if (!result.costs.empty()) continue;
      throw std::runtime_error(std::string("the fit failed at its start values: ") + error.what());
    }
    if (result.costs.empty() || found.cost < result.best.cost) result.best = found;
    result.costs.push_back(found.cost);
  }
  return result;
}

/// Continues from least squares with the robust loss; without a given width, the residuals set it.
Solution weighOutliers(const Linearisation& windows, const Free& free, const FitOptions& options,
                       const Solution& found) {
  const double delta = options.width > 0
                           ? options.width
                           : 2 * deviationOf(windows.residuals(
                                     {free.coordinates(found.scaled.data()), free.index, found.initial}));
  if (!(delta > 1e-9)) return found;  // an exact fit
  return minimiseLoss(windows, free, delta, toleranceOf(options), options.max_iterations, found);
}

/// Fits again until the weight of what is known beforehand, which follows from the residuals, stays.
Solution weighPriors(const Linearisation& windows, const FitOptions& options, const Solution& from,
                     Free& free) {
  constexpr int kMost = 10;
  constexpr double kSame = 0.02;  // relative change of a weight
  Solution found = from;
  for (int i = 0; i < kMost; ++i) {
    const double before = free.weight;
    free.weight = magnitudeOf(windows, free, found);
    found = minimiseLoss(windows, free, found.delta, toleranceOf(options), options.max_iterations, found);
    if (std::abs(free.weight - before) <= kSame * free.weight) break;
  }
  return found;
}

/// Uncertainty of the solution. First moves the solution back to its start along directions that
/// are not identifiable.
Uncertainty judge(const Linearisation& windows, const Free& free, const FitOptions& options,
                  Solution& solution) {
  const Uncertainty first = uncertainty(windows, free, solution);
  if (first.known.null_space.cols() == 0) return first;
  solution = restoreUnidentifiable(windows, free, first.known.null_space, toleranceOf(options),
                                   options.max_iterations, solution);
  Uncertainty second = uncertainty(windows, free, solution);
  for (std::size_t i = 0; i < free.index.size(); ++i)
    if (!first.known.parameter[i]) second.known.parameter[i] = false;
  return second;
}

/// The thesis's objective (3.4) from given initial states; of velocities without simulating the poses.
double thesisObjective(const SimulationError& problem, const Model& model, const Initials& initial) {
  if (problem.target() != Target::kVelocities)
    return problem.objective(simulateFrom(problem, model, initial));
  const auto sizes = [](const double* residuals, int count, double*, double*, double* loss) {
    for (int i = 0; i < count; ++i) loss[i] = std::abs(residuals[i]);
  };
  double sum = 0, samples = 0;
  for (const double loss : Linearisation(problem, model, 1).losses({model.coordinates(), {}, initial}, sizes))
    sum += loss;
  for (const Window& window : problem.windows()) samples += window.last - window.first + 1;
  if (!std::isfinite(sum)) throw std::runtime_error("the model's motion is not finite");
  return sum / samples;
}

}  // namespace
}  // namespace detail

FitResult SimulationError::fit(const Model& model, const FitOptions& options) const {
  if (options.free.empty()) throw std::invalid_argument("no parameter is free");
  if (options.starts < 1) throw std::invalid_argument("a fit needs at least one start");
  if (!(options.width >= 0)) throw std::invalid_argument("the width of the loss is negative or NaN");
  if (!options.initial.empty()) detail::checkInitials(*this, options.initial);
  std::vector<const RunData*> all;
  for (const RunData& run : runs()) all.push_back(&run);
  std::vector<std::string> unknown = options.free;
  for (const ParameterPrior& prior : options.priors)
    unknown.erase(std::remove(unknown.begin(), unknown.end(), prior.name), unknown.end());
  detail::requireIdentifiable(unknown, all);
  detail::Free free = detail::makeFree(model, options.free);
  detail::setPriors(model, options.priors, free);
  detail::keep(model, options.kept, free);
  const detail::Linearisation windows(*this, model, options.threads);

  std::unique_ptr<const SimulationError> pieces;
  if (!options.warm) pieces.reset(new SimulationError(data_, detail::shortPieces(*this), target_));
  if (!options.priors.empty()) free.weight = detail::weightAtStart(windows, free, options);
  const detail::Fits fits = detail::fitFromStarts(windows, pieces.get(), free, options);
  detail::Solution best = fits.best;
  if (detail::isRobust(options) && std::isinf(best.delta))
    best = detail::weighOutliers(windows, free, options, best);
  if (!options.priors.empty()) best = detail::weighPriors(windows, options, best, free);
  const detail::Uncertainty known = detail::judge(windows, free, options, best);

  FitResult result;
  result.model = detail::modelAt(model, free, best.scaled.data());
  result.freedom = std::max(1, known.blocks - static_cast<int>(options.free.size()));
  result.parameters = detail::estimatesOf(
      model, free, best.scaled, known.deviation(),
      Eigen::VectorXd::Constant(free.precision.size(), detail::quantileOf(result.freedom)));
  for (Eigen::Index i = 0; i < free.precision.size(); ++i) {
    const Eigen::Map<const Eigen::VectorXd> at(best.scaled.data(), free.precision.size());
    const Eigen::VectorXd shifted = at + known.shifts.col(i);
    if (free.precision(i) > 0) result.shifted.push_back(detail::modelAt(model, free, shifted.data()));
  }
  result.correlation = detail::correlationOf(known, free);
  result.condition = detail::conditionOf(known);
  result.objective = detail::thesisObjective(*this, result.model, best.initial);
  result.width = best.delta;
  result.initial = best.initial;
  result.starts = static_cast<int>(fits.costs.size());
  result.starts_at_best = fits.atBest();
  result.iterations = best.iterations;
  result.converged = best.converged;
  return result;
}

}  // namespace ground
