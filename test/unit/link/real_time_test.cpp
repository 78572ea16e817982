// Real-time priority, where the system grants it.
#include "ground/link/real_time.h"

#include <gtest/gtest.h>
#include <sched.h>

#include <chrono>
#include <string>
#include <thread>

namespace ground {
namespace real_time_test {

using Clock = std::chrono::steady_clock;

TEST(RealTime, SaysWhatIsGranted) {
  const std::string& granted = prepareRealTime();
  EXPECT_EQ(granted.find("real time: "), 0u) << granted;
  EXPECT_NE(granted.find("memory"), std::string::npos) << granted;
  EXPECT_EQ(&granted, &prepareRealTime());
}

TEST(RealTime, IsNotInherited) {
  prepareRealTime();
  std::string refused;
  int own = SCHED_OTHER, child = SCHED_OTHER;
  std::thread([&] {
    refused = prioritise(RealTimePriority::kControl);
    own = sched_getscheduler(0);
    std::thread([&child] { child = sched_getscheduler(0); }).join();
  }).join();
  EXPECT_NE(refused, "too many threads");
  if (!refused.empty()) GTEST_SKIP() << refused;
  EXPECT_EQ(own & ~SCHED_RESET_ON_FORK, SCHED_FIFO);
  EXPECT_EQ(child, SCHED_OTHER);
  EXPECT_EQ(sched_getscheduler(0), SCHED_OTHER);
}

}  // namespace real_time_test
}  // namespace ground
