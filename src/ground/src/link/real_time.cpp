#include "ground/link/real_time.h"

#include <linux/capability.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <csignal>
#include <cstring>
#include <thread>

namespace ground {
namespace {

/// Thread numbers of the real-time threads; 0 is a free place.
std::array<std::atomic<pid_t>, 64> real_time_threads;
std::atomic<bool> ran_away{false};

/// Frees the place of a thread when it ends.
struct Place {
  std::atomic<pid_t>* taken = nullptr;
  ~Place() {
    if (taken) *taken = 0;
  }
};
thread_local Place place;

/// Handles SIGXCPU. The kernel does not say which thread has computed for too long. Calls only what
/// a signal handler may call.
void takePriorities(int) {
  const int error = errno;
  ran_away = true;
  const sched_param none{};
  for (const auto& thread : real_time_threads)
    if (thread != 0) sched_setscheduler(thread, SCHED_OTHER, &none);
  static constexpr char kText[] =
      "real time: given up, because a thread computed for too long without a pause\n";
  [[maybe_unused]] const ssize_t written = write(STDERR_FILENO, kText, sizeof kText - 1);
  errno = error;
}

/// Returns an error message, or an empty string.
std::string limitComputation() {
  struct sigaction action = {};
  action.sa_handler = takePriorities;
  action.sa_flags = SA_RESTART;
  rlimit limit{};
  if (sigaction(SIGXCPU, &action, nullptr) != 0 || getrlimit(RLIMIT_RTTIME, &limit) != 0)
    return std::strerror(errno);
  limit.rlim_cur = std::min<rlim_t>(limit.rlim_max, static_cast<rlim_t>(1e6 * kLongestComputation));
  return setrlimit(RLIMIT_RTTIME, &limit) == 0 ? "" : std::strerror(errno);
}

/// Whether this process may lock any amount of memory.
bool maySkipLimit() {
  __user_cap_header_struct header{_LINUX_CAPABILITY_VERSION_3, 0};
  __user_cap_data_struct data[_LINUX_CAPABILITY_U32S_3] = {};
  return syscall(SYS_capget, &header, data) == 0 &&
         (data[CAP_TO_INDEX(CAP_IPC_LOCK)].effective & CAP_TO_MASK(CAP_IPC_LOCK)) != 0;
}

/// Returns an error message, or an empty string.
std::string lockMemory() {
  // With a limit, the process would later be refused memory that it needs.
  rlimit limit{};
  if (getrlimit(RLIMIT_MEMLOCK, &limit) != 0) return std::strerror(errno);
  limit.rlim_cur = limit.rlim_max;
  const bool unlimited =
      limit.rlim_max == RLIM_INFINITY && setrlimit(RLIMIT_MEMLOCK, &limit) == 0;
  if (!unlimited && !maySkipLimit())
    return "its limit, memlock, is " + std::to_string(limit.rlim_max >> 10) + " kB";
#ifdef MCL_ONFAULT  // not the unused pages of stacks
  const int pages = MCL_CURRENT | MCL_FUTURE | MCL_ONFAULT;
#else
  const int pages = MCL_CURRENT | MCL_FUTURE;
#endif
  return mlockall(pages) == 0 ? "" : std::strerror(errno);
}

}  // namespace

const std::string& prepareRealTime() {
  static const std::string granted = [] {
    const std::string unlimited = limitComputation();
    std::string refused;
    if (unlimited.empty())
      std::thread([&refused] { refused = prioritise(RealTimePriority::kReport); }).join();
    else
      refused = "its computing time cannot be limited: " + unlimited;
    std::string text = "real time: ";
    text += refused.empty() ? "priority granted" : "no priority (" + refused + ")";
    const std::string unlocked = lockMemory();
    text += unlocked.empty() ? ", memory locked" : ", memory not locked (" + unlocked + ")";
    return text;
  }();
  return granted;
}

std::string prioritise(RealTimePriority priority) {
  if (ran_away) return "a thread computed for too long";
  if (!place.taken) {
    const auto self = static_cast<pid_t>(syscall(SYS_gettid));
    for (auto& thread : real_time_threads) {
      pid_t free = 0;
      if (!thread.compare_exchange_strong(free, self)) continue;
      place.taken = &thread;
      break;
    }
    if (!place.taken) return "too many threads";
  }
  sched_param wanted{};
  wanted.sched_priority = static_cast<int>(priority);
  if (sched_setscheduler(0, SCHED_FIFO | SCHED_RESET_ON_FORK, &wanted) == 0) return "";
  return std::strerror(errno);
}

}  // namespace ground
