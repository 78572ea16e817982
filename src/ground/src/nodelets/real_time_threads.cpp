#include "ground/nodelets/real_time_threads.h"

#include <ros/poll_manager.h>

#include <atomic>
#include <chrono>
#include <memory>
#include <thread>

#include "ground/nodelets/parameters.h"

namespace ground {
namespace {

/// The thread that receives poses and hands messages to other processes belongs to roscpp.
void prioritisePollThread() {
  const auto done = std::make_shared<std::atomic<bool>>(false);
  const auto& manager = ros::PollManager::instance();
  const auto connection = manager->addPollThreadListener([done] {
    if (!*done) prioritise(RealTimePriority::kReceive);
    *done = true;
  });
  manager->getPollSet().signal();
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(1);
  while (!*done && std::chrono::steady_clock::now() < deadline)
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  manager->removePollThreadListener(connection);
}

}  // namespace

bool wantsRealTime(const ros::NodeHandle& nh) {
  if (!optionalParameter<bool>(nh, "real_time", false)) return false;
  static const bool once = [] {
    ROS_INFO("%s", prepareRealTime().c_str());
    prioritisePollThread();
    return true;
  }();
  return once;
}

}  // namespace ground
