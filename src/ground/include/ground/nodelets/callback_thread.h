#pragma once

#include <ros/callback_queue.h>
#include <ros/ros.h>

#include <atomic>
#include <thread>

#include "ground/link/real_time.h"

namespace ground {

/// A queue of ROS callbacks with its own thread: its callbacks wait for each other, but not for the
/// other nodelets of the manager.
///
/// Declare it before the publishers, subscribers and services that use it: they refer to its queue
/// until they are destroyed. (A nodelet manager destroys the queues that it lends before a nodelet
/// whose onInit has thrown, and then crashes.)
class CallbackThread {
 public:
  CallbackThread() : thread_([this] { run(); }) {}
  ~CallbackThread() { stop(); }
  CallbackThread(const CallbackThread&) = delete;
  CallbackThread& operator=(const CallbackThread&) = delete;

  /// A handle of the same namespace whose callbacks run in this thread.
  ros::NodeHandle handle(ros::NodeHandle nh) {
    nh.setCallbackQueue(&queue_);
    return nh;
  }

  /// Gives the thread a real-time priority, from its next callback on; see prepareRealTime().
  void prioritise(RealTimePriority priority) { priority_ = static_cast<int>(priority); }

  /// No callback runs after it returns. Do not call it from a callback.
  void stop() {
    alive_ = false;
    queue_.disable();
    if (thread_.joinable()) thread_.join();
  }

 private:
  void run() {
    // disable() ends the wait; afterwards the queue neither waits nor calls.
    while (alive_) {
      if (const int priority = priority_.exchange(0))
        ground::prioritise(static_cast<RealTimePriority>(priority));
      queue_.callAvailable(ros::WallDuration(kLook));
    }
  }

  static constexpr double kLook = 0.2;  // longest wait for a change of the priority [s]

  ros::CallbackQueue queue_;
  std::atomic<bool> alive_{true};
  std::atomic<int> priority_{0};  ///< a change that the thread has not seen yet, or 0
  std::thread thread_;
};

}  // namespace ground
