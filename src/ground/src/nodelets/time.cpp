#include "ground/nodelets/time.h"

#include <algorithm>
#include <mutex>

#include "ground/nodelets/inheriting_mutex.h"

namespace ground {

WatchdogClock::time_point WatchdogClock::now() {
  static InheritingMutex mutex;
  static auto last = std::chrono::steady_clock::now();
  static time_point watched(last.time_since_epoch());
  const std::lock_guard lock(mutex);
  const auto now = std::chrono::steady_clock::now();
  duration passed = now - last;
  last = now;
  if (ros::Time::isSimTime()) passed = std::min<duration>(passed, kLongestPause);
  return watched += passed;
}

}  // namespace ground
