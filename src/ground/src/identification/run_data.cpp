#include "ground/identification/run_data.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace ground {
namespace {

bool ascends(const std::vector<double>& times) {
  return std::is_sorted(times.begin(), times.end()) &&
         std::all_of(times.begin(), times.end(), [](double t) { return std::isfinite(t); });
}

bool isValid(const Payload& payload) {
  return payload.mass >= 0 && payload.inertia >= 0 && std::isfinite(payload.mass) &&
         std::isfinite(payload.inertia) && payload.place.allFinite();
}

}  // namespace

void checkRun(const RunData& run) {
  const auto require = [&run](bool good, const char* wrong) {
    if (!good) throw std::invalid_argument(run.name + ": " + wrong);
  };
  const auto count = static_cast<Eigen::Index>(run.times.size());
  require(count > 0, "it has no samples");
  require(run.eta.rows() == count && run.nu.rows() == count &&
              (run.poses.rows() == count || run.poses.rows() == 0),
          "times, eta, nu and poses differ in length");
  require(run.eta.allFinite() && run.nu.allFinite() && run.poses.allFinite(), "a measurement is not finite");
  require(ascends(run.times), "times descend or are not finite");
  require(run.noise.allFinite() && run.noise.minCoeff() > 0,
          "the noise of poses must be positive and finite");
  const RunScales& scales = run.scales;
  for (const double scale : {scales.max_gap, scales.linear_jerk, scales.angular_jerk, scales.window})
    require(scale > 0, "its scales must be positive");
  require((run.wrench.rows() == count || run.wrench.rows() == 0) && run.wrench.allFinite(),
          "the known wrench is not finite or lacks rows");
  const InertialData& inertial = run.inertial;
  require(inertial.values.rows() == static_cast<Eigen::Index>(inertial.times.size()) &&
              inertial.values.allFinite() && ascends(inertial.times),
          "inertial samples are not finite, or their times are not or descend");
  require(isValid(run.payload),
          "the mass and inertia of its payload must be finite and not negative, its place finite");
  require(inertial.noise.allFinite() && inertial.noise.minCoeff() > 0 && inertial.place.allFinite(),
          "the noise of inertial samples must be positive and finite, their place finite");
}

std::vector<Window> cutWindows(const RunData& run, int run_index, double from, double to, double length,
                               std::optional<double> max_gap) {
  checkRun(run);
  const double longest = max_gap.value_or(run.scales.max_gap);
  if (!(longest > 0)) throw std::invalid_argument("the longest gap must be positive");
  if (!(length > 0)) throw std::invalid_argument("the length of windows must be positive");
  if (run_index < 0) throw std::invalid_argument("the index of a run is negative");
  if (std::isnan(from) || std::isnan(to)) throw std::invalid_argument("windows need a start and an end");
  constexpr int kMinSamples = 6;  // enough to identify an initial velocity
  std::vector<Window> windows;
  const auto add = [&](int first, int last) {
    const double duration = run.times[last] - run.times[first];
    if (last - first + 1 >= kMinSamples && duration > 0.5 * length)
      windows.push_back({run_index, first, last});
  };
  int first = -1;
  const auto begin = std::lower_bound(run.times.begin(), run.times.end(), from);
  const auto end = std::upper_bound(begin, run.times.end(), to);
  const int count = static_cast<int>(end - run.times.begin());
  for (int i = static_cast<int>(begin - run.times.begin()); i < count; ++i) {
    if (first >= 0 && run.times[i] - run.times[i - 1] > longest) {
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

}  // namespace ground
