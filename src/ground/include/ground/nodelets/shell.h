#pragma once

#include <nodelet/nodelet.h>
#include <ros/ros.h>

#include "ground/nodelets/callback_thread.h"

namespace ground {

/// Base of all nodelets: runs their callbacks in a thread of their own, and says why one does not start.
class Shell : public nodelet::Nodelet {
 protected:
  /// Loads parameters, advertises and subscribes. `nh` is the private handle, `topics` the handle of topics.
  /// An exception is logged and ends the nodelet.
  virtual void start(ros::NodeHandle& nh, ros::NodeHandle& topics) = 0;

  CallbackThread callbacks_;

 private:
  void onInit() final {
    ros::NodeHandle nh = callbacks_.handle(getPrivateNodeHandle());
    ros::NodeHandle topics = callbacks_.handle(getNodeHandle());
    try {
      start(nh, topics);
    } catch (const std::exception& error) {
      NODELET_FATAL("%s: %s", getName().c_str(), error.what());
      throw;
    }
  }
};

}  // namespace ground
