// The fit by simulation error, step by step.
#include <algorithm>
#include <cmath>
#include <memory>
#include <stdexcept>
#include <string>

#include "checks.h"
#include "descent.h"
#include "estimates.h"
#include "linearisation.h"
#include "starts.h"
#include "uncertainty.h"
#include "window_residuals.h"

namespace ground {
namespace detail {
namespace {

/// Descents from all starts that could be simulated.
struct Descents {
  Solution best;
  std::vector<double> costs;  ///< cost at the end of each

  /// How many converged to the best cost.
  int atBest() const {
    const double same = best.cost + 1e-4 * std::abs(best.cost) + 1e-12;
    return static_cast<int>(
        std::count_if(costs.begin(), costs.end(), [&](double cost) { return cost <= same; }));
  }
};

bool isRobust(const FitOptions& options) { return options.objective == FitOptions::Objective::kLeastSquares; }

/// Descends from every start, after a fit to short pieces if given. Throws std::runtime_error if
/// the descent from the model's values, which the user chose, fails.
Descents descendFromStarts(Linearisation& windows, const SimulationError* short_pieces, const Free& free,
                           const FitOptions& options) {
  const Model& model = windows.model();
  const std::vector<double> losses = options.near && isRobust(options) && options.width > 0
                                         ? std::vector<double>{options.width}
                                         : lossesOf(options.objective);
  std::unique_ptr<Linearisation> pieces;
  if (short_pieces) pieces = std::make_unique<Linearisation>(*short_pieces, model, options.threads);
  Descents result;
  for (const std::vector<double>& start : startsOf(free, options.starts)) {
    Solution found;
    try {
      const std::vector<double> from = pieces ? approach(windows, *pieces, free, options, start) : start;
      found = descend(windows, free, losses, options, from,
                      initialsAt(from, windows.problem(), model, free, options));
      if (!found.usable) throw std::runtime_error(found.message);
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
/// Returns `found` for an exact fit or if the robust fit fails.
Solution weighOutliers(Linearisation& windows, const Free& free, const FitOptions& options,
                       const Solution& found) {
  const double delta = options.width > 0
                           ? options.width
                           : 2 * deviationOf(windows.residuals(
                                     {free.coordinates(found.scaled.data()), free.index, found.initial}));
  if (!(delta > 1e-9)) return found;  // an exact fit
  Solution robust = descend(windows, free, {delta}, options, found.scaled, found.initial);
  if (!robust.usable) return found;
  robust.iterations += found.iterations;
  return robust;
}

/// Uncertainty of the solution. First moves the solution back to its start along directions that
/// are not identifiable.
Uncertainty judge(Linearisation& windows, const Free& free, const FitOptions& options, Solution& solution) {
  const Uncertainty first = uncertainty(windows, free, solution, options.block);
  if (first.unseen.cols() == 0) return first;
  solution = startKept(windows, free, first.unseen, options, solution);
  Uncertainty second = uncertainty(windows, free, solution, options.block);
  for (std::size_t i = 0; i < second.identified.size(); ++i)
    second.identified[i] = second.identified[i] && first.identified[i];
  return second;
}

/// The model with the values of a solution.
Model modelAt(const Model& model, const Free& free, const Solution& solution) {
  const std::vector<double> coordinates = free.coordinates(solution.scaled.data());
  const auto infos = model.parameters();
  std::vector<double> values = model.values();
  // Rounding may take a value at a bound out of its range.
  for (const int i : free.index)
    values[i] = std::clamp(infos[i].fromCoordinate(coordinates[i]), infos[i].lower, infos[i].upper);
  Model result = model;
  result.setValues(values);
  return result;
}

/// The thesis's objective (3.4) from given initial states. Throws std::runtime_error if the model
/// cannot be simulated.
double thesisObjective(const SimulationError& problem, const Model& model, const Initials& initial) {
  if (problem.target() != Target::kVelocities)
    return problem.objective(simulateFrom(problem, model, initial));
  const auto sizes = [](const double* residuals, int count, double*, double*, double* loss) {
    for (int i = 0; i < count; ++i) loss[i] = std::abs(residuals[i]);
  };
  const std::vector<double> sums =
      Linearisation(problem, model, 1).losses({model.coordinates(), {}, initial}, sizes);
  double sum = 0;
  int samples = 0;
  for (std::size_t w = 0; w < sums.size(); ++w) {
    const Window& window = problem.windows()[w];
    if (!std::isfinite(sums[w])) throw std::runtime_error(notFinite(problem.runs()[window.run], window));
    sum += sums[w];
    samples += window.last - window.first + 1;
  }
  return sum / samples;
}

}  // namespace
}  // namespace detail

FitResult SimulationError::fit(const Model& model, const FitOptions& options) const {
  if (options.free.empty()) throw std::invalid_argument("no parameter is free");
  if (options.starts < 1) throw std::invalid_argument("a fit needs at least one start");
  if (!(options.width >= 0)) throw std::invalid_argument("the width of the loss is negative or NaN");
  if (!options.initial.empty()) detail::checkInitials(*this, options.initial);
  const detail::Free free = detail::makeFree(model, options.free);
  detail::Linearisation windows(*this, model, options.threads);

  std::unique_ptr<const SimulationError> pieces;
  if (!options.near) pieces.reset(new SimulationError(data_, detail::shortPieces(*this), target_));
  const detail::Descents descents = detail::descendFromStarts(windows, pieces.get(), free, options);
  detail::Solution best = descents.best;
  if (detail::isRobust(options) && std::isinf(best.delta))
    best = detail::weighOutliers(windows, free, options, best);
  const detail::Uncertainty known = detail::judge(windows, free, options, best);

  FitResult result;
  result.model = detail::modelAt(model, free, best);
  result.parameters = detail::intervalsOf(known, free, best.scaled, model, result.model);
  result.correlation = detail::correlationOf(known, free);
  result.condition = detail::conditionOf(known);
  result.objective = detail::thesisObjective(*this, result.model, best.initial);
  result.width = best.delta;
  result.initial = best.initial;
  result.starts = static_cast<int>(descents.costs.size());
  result.starts_at_best = descents.atBest();
  result.iterations = best.iterations;
  result.converged = best.converged;
  result.message = best.message;
  return result;
}

}  // namespace ground
