#include "ground/nodelets/time.h"

#include <algorithm>
#include <mutex>

namespace ground {

WatchdogClock::time_point WatchdogClock::now() {
  static std::mutex mutex;
  static auto last = std::chrono::steady_clock::now();
  static time_point watched(last.time_since_epoch());
  const std::lock_guard<std::mutex> lock(mutex);
  const auto now = std::chrono::steady_clock::now();
  duration passed = now - last;
  last = now;
  if (ros::Time::isSimTime()) passed = std::min<duration>(passed, kLongestPause);
  return watched += passed;
}

}  // namespace ground
