#pragma once

#include <ground_msgs/LiveChange.h>
#include <ros/ros.h>

#include <string>
#include <vector>

namespace ground {

/// Logs and publishes changes that a user makes while a node runs: one log line for simultaneous
/// changes, and one message on `live_changes` for each; recordings contain this topic.
class LiveChanges {
 public:
  struct Change {
    std::string name;  ///< name of a parameter
    std::string before, after;
  };

  LiveChanges() = default;
  /// `nh`: private handle of the node.
  explicit LiveChanges(const ros::NodeHandle& nh) : node_(nh.getNamespace().substr(1)) {
    ros::NodeHandle topics(ros::names::parentNamespace(nh.getNamespace()));
    publisher_ = topics.advertise<ground_msgs::LiveChange>("live_changes", 100);
  }

  /// Reports simultaneous changes; does nothing if there are none.
  void report(const std::vector<Change>& changes) const {
    std::string line;
    for (const Change& change : changes) {
      ground_msgs::LiveChange message;
      message.header.stamp = ros::Time::now();
      message.node = node_;
      message.name = change.name;
      message.before = change.before;
      message.after = change.after;
      publisher_.publish(message);
      if (!line.empty()) line += ", ";
      line += change.name + " " + change.before + " -> " + change.after;
    }
    if (!line.empty()) ROS_INFO("%s: %s", node_.c_str(), line.c_str());
  }

 private:
  std::string node_;
  ros::Publisher publisher_;
};

}  // namespace ground
