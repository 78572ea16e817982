#include "ground/nodelets/real_time_threads.h"

#include <ros/poll_manager.h>

#include <chrono>
#include <memory>
#include <thread>

#include "ground/nodelets/parameters.h"

namespace ground {
namespace {

/// Gives priority to the thread of roscpp that receives poses and hands messages to other processes.
///
/// While an ordinary thread holds a connection, that thread does not sleep but tries again and
/// again. With priority it could keep the other from the processor for ever, hence it pauses when it
/// goes round too often.
class PollThread {
 public:
  PollThread() : connection_(manager_->addPollThreadListener([this] { round(); })) {
    manager_->getPollSet().signal();
  }
  /// No round is under way after it returns.
  ~PollThread() { manager_->removePollThreadListener(connection_); }

 private:
  using Clock = std::chrono::steady_clock;
  static constexpr std::chrono::milliseconds kWindow{1};
  static constexpr int kMostRounds = 50;  // in a window; a message takes one or two
  static constexpr std::chrono::microseconds kPause{100};

  /// Runs in the poll thread, each time before it waits for messages.
  void round() {
    if (!prioritised_) prioritise(RealTimePriority::kReceive);
    prioritised_ = true;
    const Clock::time_point now = Clock::now();
    if (now - window_ > kWindow) {
      window_ = now;
      rounds_ = 0;
    }
    if (++rounds_ > kMostRounds) std::this_thread::sleep_for(kPause);
  }

  bool prioritised_ = false;
  Clock::time_point window_;  ///< its start
  int rounds_ = 0;            ///< in this window
  const ros::PollManagerPtr manager_ = ros::PollManager::instance();
  boost::signals2::connection connection_;
};

}  // namespace

bool wantsRealTime(const ros::NodeHandle& nh) {
  if (!optionalParameter<bool>(nh, "real_time", false)) return false;
  static const auto once = [] {
    ROS_INFO("%s", prepareRealTime().c_str());
    return std::make_unique<PollThread>();
  }();
  return once != nullptr;
}

}  // namespace ground
