#include "ground/identification/run_data.h"

#include <algorithm>
#include <cmath>
#include <sstream>
#include <stdexcept>

#include "checks.h"

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
  require((run.wrench.rows() == count || run.wrench.rows() == 0) && run.wrench.allFinite(),
          "the known wrench is not finite or has not a row a sample");
  const InertialData& inertial = run.inertial;
  require(inertial.values.rows() == static_cast<Eigen::Index>(inertial.times.size()) &&
              inertial.values.allFinite() && ascends(inertial.times),
          "inertial samples are not finite, or their times are not or descend");
  require(isValid(run.payload),
          "the mass and inertia of its payload must be finite and not negative, its place finite");
  require(inertial.noise.allFinite() && inertial.noise.minCoeff() > 0 && inertial.place.allFinite(),
          "the noise of inertial samples must be positive and finite, their place finite");
}

namespace detail {

void checkFree(const RunData& run) {
  checkRun(run);
  if (run.wrench.rows() > 0) throw std::invalid_argument(run.name + ": only GreyBox takes a known wrench");
}

void checkGap(double max_gap) {
  if (!(max_gap > 0)) throw std::invalid_argument("the longest gap must be positive");
}

std::string notFinite(const RunData& run, const Window& window) {
  std::ostringstream out;
  out << "the model's motion is not finite in " << run.name << " from "
      << run.times[static_cast<std::size_t>(window.first)] << " to "
      << run.times[static_cast<std::size_t>(window.last)] << " s";
  return out.str();
}

}  // namespace detail

std::vector<Window> cutWindows(const RunData& run, int run_index, double from, double to, double length,
                               double max_gap) {
  checkRun(run);
  detail::checkGap(max_gap);
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

}  // namespace ground
