// Real-time priority, where the system grants it.
#include <gtest/gtest.h>
#include <sched.h>

#include <chrono>
#include <string>
#include <thread>

#include "ground/link/real_time.h"

namespace ground {
namespace {

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

// The last test: afterwards the process has no real-time thread any more.
TEST(RealTime, IsTakenFromAllThreadsWhenOneRunsAway) {
  prepareRealTime();
  std::string refused;
  int runaway = SCHED_FIFO, other = SCHED_FIFO;
  std::thread([&] {
    refused = prioritise(RealTimePriority::kSend);
    if (!refused.empty()) return;
    std::thread spinning([&] {
      prioritise(RealTimePriority::kControl);
      const auto deadline = Clock::now() + std::chrono::seconds(30);
      while (sched_getscheduler(0) != SCHED_OTHER && Clock::now() < deadline) {
      }
      runaway = sched_getscheduler(0);
    });
    spinning.join();
    other = sched_getscheduler(0);
  }).join();
  if (!refused.empty()) GTEST_SKIP() << refused;
  EXPECT_EQ(runaway, SCHED_OTHER);
  EXPECT_EQ(other, SCHED_OTHER);
  EXPECT_NE(prioritise(RealTimePriority::kSend), "");
}

}  // namespace
}  // namespace ground

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
