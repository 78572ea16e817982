#include "ground/identification/run_data.h"

#include <algorithm>
#include <stdexcept>

namespace ground {

std::vector<Window> cutWindows(const RunData& run, int run_index, double from, double to,
                               double length, double max_gap) {
  if (!(length > 0)) throw std::invalid_argument("the length of windows must be positive");
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
