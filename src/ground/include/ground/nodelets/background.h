#pragma once

#include <ros/console.h>

#include <condition_variable>
#include <deque>
#include <functional>
#include <mutex>
#include <string>
#include <thread>
#include <utility>

#include "ground/nodelets/inheriting_mutex.h"

namespace ground {

/// Runs what may block, such as lines for the log of ROS, in its own thread and in order, so that a
/// terminal, a disk or a master that hangs does not hold the callers. Call from any thread.
class Background {
 public:
  using Task = std::function<void()>;

  Background() : thread_([this] { run(); }) {}
  /// Does what is left, and waits for it.
  ~Background() {
    {
      const std::lock_guard lock(mutex_);
      alive_ = false;
    }
    wake_.notify_all();
    thread_.join();
  }
  Background(const Background&) = delete;
  Background& operator=(const Background&) = delete;

  void info(std::string text) {
    add([text = std::move(text)] { ROS_INFO("%s", text.c_str()); });
  }
  void warn(std::string text) {
    add([text = std::move(text)] { ROS_WARN("%s", text.c_str()); });
  }
  void add(Task task) {
    {
      const std::lock_guard lock(mutex_);
      if (tasks_.size() >= kMostTasks) {
        ++lost_;
        return;
      }
      tasks_.push_back(std::move(task));
    }
    wake_.notify_all();
  }

 private:
  static constexpr std::size_t kMostTasks = 1000;  // kept while one blocks

  void run() {
    std::unique_lock lock(mutex_);
    while (true) {
      wake_.wait(lock, [this] { return !alive_ || !tasks_.empty(); });
      if (tasks_.empty()) return;
      const std::deque<Task> tasks = std::exchange(tasks_, {});
      const std::size_t lost = std::exchange(lost_, 0);
      lock.unlock();
      for (const Task& task : tasks) task();
      if (lost > 0) ROS_WARN("the log or a publisher was blocked: %zu lines and messages are lost", lost);
      lock.lock();
    }
  }

  InheritingMutex mutex_;  ///< guards all members down to wake_
  std::deque<Task> tasks_;
  std::size_t lost_ = 0;
  bool alive_ = true;
  std::condition_variable_any wake_;
  std::thread thread_;
};

}  // namespace ground
