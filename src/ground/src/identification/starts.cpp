#include "starts.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <random>
#include <stdexcept>

#include "checks.h"
#include "descent.h"
#include "parallel.h"
#include "window_residuals.h"

namespace ground::detail {
namespace {

constexpr double kPieceLength = 0.3;        // length of short pieces [s]
constexpr std::size_t kMaxPieces = 64;      // enough for an approximate solution
constexpr double kInitialTolerance = 1e-4;  // cost per sample; the following fit refines it

/// The sum of squares with the measured initial states. Throws std::runtime_error if a window's
/// simulation is not finite, because the solver would write its own message to stderr.
double squaresOf(Linearisation& windows, const Free& free, const std::vector<double>& scaled) {
  const Initials initial = measuredInitials(windows.problem());
  const std::vector<double> losses =
      windows.losses({free.coordinates(scaled.data()), free.index, initial}, RobustLoss().weighing());
  for (std::size_t w = 0; w < losses.size(); ++w)
    if (!std::isfinite(losses[w])) {
      const Window& window = windows.problem().windows()[w];
      throw std::runtime_error(notFinite(windows.problem().runs()[window.run], window));
    }
  return std::accumulate(losses.begin(), losses.end(), 0.0);
}

}  // namespace

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
      scaled[i] = s == 0 ? given : lower >= 0 ? std::max(given, 0.1) * std::pow(10, way) : given + way;
      scaled[i] = std::min(std::max(scaled[i], lower), upper);
    }
    starts.push_back(scaled);
  }
  return starts;
}

std::vector<Window> shortPieces(const SimulationError& problem) {
  std::vector<Window> all;
  for (const Window& w : problem.windows()) {
    const RunData& run = problem.runs()[w.run];
    const auto found = cutWindows(run, w.run, run.times[w.first], run.times[w.last], kPieceLength);
    all.insert(all.end(), found.begin(), found.end());
  }
  if (all.empty()) return problem.windows();
  const std::size_t count = std::min(all.size(), kMaxPieces);
  for (std::size_t i = 0; i < count; ++i) all[i] = all[i * all.size() / count];
  all.resize(count);
  return all;
}

std::vector<double> approach(Linearisation& windows, Linearisation& pieces, const Free& free,
                             const FitOptions& options, const std::vector<double>& from) {
  const double far = squaresOf(windows, free, from);
  const Solution near = descend(pieces, free, {kInfinity}, options, from, measuredInitials(pieces.problem()),
                                kApproachTolerance);
  try {
    if (near.usable && squaresOf(windows, free, near.scaled) < far) return near.scaled;
  } catch (const std::runtime_error&) {
    // Values that fit short windows may diverge over long ones.
  }
  return from;
}

Initials initialsAt(const std::vector<double>& scaled, const SimulationError& problem, const Model& model,
                    const Free& free, const FitOptions& options) {
  if (!options.initial.empty()) return options.initial;
  Initials initial = measuredInitials(problem);
  if (!options.near) return initial;
  const std::vector<double> coordinates = free.coordinates(scaled.data());
  const RobustLoss robust{options.width > 0 ? options.width : kInfinity};
  inParallel(initial.size(), options.threads, [&](std::size_t w) {
    solveInitial(problem, model, coordinates, robust, static_cast<int>(w), initial[w], kInitialTolerance);
  });
  return initial;
}

}  // namespace ground::detail
