#pragma once

#include <ros/console.h>

#include <condition_variable>
#include <deque>
#include <mutex>
#include <string>
#include <thread>
#include <utility>

#include "ground/nodelets/inheriting_mutex.h"

namespace ground {

/// Writes lines to the log of ROS in its own thread, so that a terminal or a disk that blocks does
/// not hold its callers. Call from any thread.
class BackgroundLog {
 public:
  BackgroundLog() : thread_([this] { run(); }) {}
  /// Writes what is left, and waits for it.
  ~BackgroundLog() {
    {
      const std::lock_guard lock(mutex_);
      alive_ = false;
    }
    wake_.notify_all();
    thread_.join();
  }
  BackgroundLog(const BackgroundLog&) = delete;
  BackgroundLog& operator=(const BackgroundLog&) = delete;

  void info(std::string text) { add({false, std::move(text)}); }
  void warn(std::string text) { add({true, std::move(text)}); }

 private:
  struct Line {
    bool warns;
    std::string text;
  };
  static constexpr std::size_t kMostLines = 1000;  // lines kept while the log blocks

  void add(Line line) {
    {
      const std::lock_guard lock(mutex_);
      if (lines_.size() >= kMostLines) {
        ++lost_;
        return;
      }
      lines_.push_back(std::move(line));
    }
    wake_.notify_all();
  }

  void run() {
    std::unique_lock lock(mutex_);
    while (true) {
      wake_.wait(lock, [this] { return !alive_ || !lines_.empty(); });
      if (lines_.empty()) return;
      const std::deque<Line> lines = std::exchange(lines_, {});
      const std::size_t lost = std::exchange(lost_, 0);
      lock.unlock();
      for (const Line& line : lines)
        ROS_LOG(line.warns ? ros::console::levels::Warn : ros::console::levels::Info, ROSCONSOLE_DEFAULT_NAME,
                "%s", line.text.c_str());
      if (lost > 0) ROS_WARN("the log was blocked: %zu lines are lost", lost);
      lock.lock();
    }
  }

  InheritingMutex mutex_;  ///< guards all members down to wake_
  std::deque<Line> lines_;
  std::size_t lost_ = 0;
  bool alive_ = true;
  std::condition_variable_any wake_;
  std::thread thread_;
};

}  // namespace ground
