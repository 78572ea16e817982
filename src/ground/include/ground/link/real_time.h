#pragma once

#include <string>

namespace ground {

/// Priorities under SCHED_FIFO of the threads between a pose and its packet. They rise on the way, so
/// that each step interrupts the one before it. They stay below the priority of interrupts (50).
enum class RealTimePriority {
  kReport = 30,  ///< tells others what happened
  kReceive,      ///< exchanges messages with other processes
  kEstimate,
  kControl,
  kSend,
};

/// Prepares this process for real-time threads: keeps its memory from being swapped out. Returns what
/// the system grants, for the log. Only the first call acts.
const std::string& prepareRealTime();

/// Gives the calling thread a priority, until it ends; threads that it starts do not inherit it.
/// Call prepareRealTime() first. Returns why the system refuses, or an empty string.
std::string prioritise(RealTimePriority priority);

}  // namespace ground
