#pragma once

#include <ros/callback_queue.h>
#include <ros/ros.h>

#include <atomic>
#include <thread>

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

  /// No callback runs after it returns. Do not call it from a callback.
  void stop() {
    alive_ = false;
    queue_.disable();
    if (thread_.joinable()) thread_.join();
  }

 private:
  void run() {
    // disable() ends the wait; afterwards the queue neither waits nor calls.
    while (alive_) queue_.callAvailable(ros::WallDuration(1));
  }

  ros::CallbackQueue queue_;
  std::atomic<bool> alive_{true};
  std::thread thread_;
};

}  // namespace ground
