#include "ground/link/real_time.h"

#include <sched.h>
#include <sys/mman.h>
#include <sys/resource.h>

#include <cerrno>
#include <cstring>
#include <thread>

namespace ground {
namespace {

/// Returns an error message, or an empty string.
std::string lockMemory() {
  // With a limit, the process would later be refused memory that it needs.
  const rlimit unlimited{RLIM_INFINITY, RLIM_INFINITY};
  if (setrlimit(RLIMIT_MEMLOCK, &unlimited) != 0) {
    rlimit limit{};
    getrlimit(RLIMIT_MEMLOCK, &limit);
    return "its limit, memlock, is " + std::to_string(limit.rlim_max >> 10) + " kB";
  }
  // Not the unused pages of stacks.
  return mlockall(MCL_CURRENT | MCL_FUTURE | MCL_ONFAULT) == 0 ? "" : std::strerror(errno);
}

}  // namespace

const std::string& prepareRealTime() {
  static const std::string granted = [] {
    std::string refused;
    std::thread([&refused] { refused = prioritise(RealTimePriority::kReport); }).join();
    const std::string unlocked = lockMemory();
    return "real time: " + (refused.empty() ? "priority granted" : "no priority (" + refused + ")") +
           (unlocked.empty() ? ", memory locked" : ", memory not locked (" + unlocked + ")");
  }();
  return granted;
}

std::string prioritise(RealTimePriority priority) {
  sched_param wanted{};
  wanted.sched_priority = static_cast<int>(priority);
  if (sched_setscheduler(0, SCHED_FIFO | SCHED_RESET_ON_FORK, &wanted) == 0) return "";
  return std::strerror(errno);
}

}  // namespace ground
