#include "ground/nodelets/time.h"

#include <algorithm>
#include <chrono>
#include <mutex>

#include "ground/nodelets/inheriting_mutex.h"

namespace ground {

double steadyNow() {
  using Seconds = std::chrono::duration<double>;
  constexpr double kLongestPause = 0.05;  // [s]
  static InheritingMutex mutex;
  static auto last = std::chrono::steady_clock::now();
  static double watched = Seconds(last.time_since_epoch()).count();
  const std::lock_guard lock(mutex);
  const auto now = std::chrono::steady_clock::now();
  const double passed = Seconds(now - last).count();
  last = now;
  return watched += ros::Time::isSimTime() ? std::min(passed, kLongestPause) : passed;
}

}  // namespace ground
