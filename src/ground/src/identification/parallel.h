// Distributes work over threads.
#pragma once

#include <sched.h>

#include <algorithm>
#include <atomic>
#include <exception>
#include <mutex>
#include <system_error>
#include <thread>
#include <vector>

namespace ground::detail {

/// Number of threads: `wanted`, or for 0 the number of cores that the process may use.
inline int threadCount(int wanted) {
  if (wanted > 0) return wanted;
  cpu_set_t cores;
  if (sched_getaffinity(0, sizeof cores, &cores) == 0) return std::max(1, CPU_COUNT(&cores));
  return std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
}

/// The threads that are inside inParallel, in the whole process.
class BusyThreads {
 public:
  /// Counts one more thread. Unless `always`, only if that makes no more than there are cores;
  /// returns whether it did.
  static bool add(bool always) {
    int busy = count();
    while (always || busy < threadCount(0))
      if (count().compare_exchange_weak(busy, busy + 1)) return true;
    return false;
  }
  /// Counts a thread less when it goes out of scope.
  struct Leave {
    ~Leave() { --count(); }
  };

 private:
  static std::atomic<int>& count() {
    static std::atomic<int> busy{0};
    return busy;
  }
};

/// Calls `work(i)` for i = 0 … count - 1 from several threads. `threads` is their number; 0 means
/// the calling thread and one for each core that no other call uses, so that calls from several
/// threads share the cores. If calls throw, no further ones begin, and the exception of the first
/// in order is thrown after all threads have ended, as in a loop.
template <class Work>
void inParallel(std::size_t count, int threads, const Work& work) {
  std::atomic<std::size_t> next{0};
  std::mutex mutex;  // guards the next two
  std::exception_ptr failure;
  std::size_t failed = count;
  const auto run = [&] {
    const BusyThreads::Leave leave;
    std::size_t i = next++;
    try {
      for (; i < count; i = next++) work(i);
    } catch (...) {
      next = count;
      const std::lock_guard<std::mutex> lock(mutex);
      if (i < failed) {
        failed = i;
        failure = std::current_exception();
      }
    }
  };
  const std::size_t wanted = std::min<std::size_t>(threadCount(threads), count);
  std::vector<std::thread> others;
  others.reserve(wanted);
  BusyThreads::add(true);
  while (others.size() + 1 < wanted && BusyThreads::add(threads > 0)) {
    try {
      others.emplace_back(run);
    } catch (const std::system_error&) {  // the system has no more threads: fewer do the work
      const BusyThreads::Leave leave;
      break;
    }
  }
  run();
  for (std::thread& thread : others) thread.join();
  if (failure) std::rethrow_exception(failure);
}

}  // namespace ground::detail
