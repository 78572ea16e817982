#pragma once

#include <ros/ros.h>

#include "ground/link/real_time.h"

namespace ground {

/// Whether a nodelet's threads ask for real-time priority: its private parameter real_time (false).
/// If so, the process is prepared, the thread in which roscpp exchanges messages with other
/// processes gets its priority, and a log line says what the system grants; all this once for a
/// process.
bool wantsRealTime(const ros::NodeHandle& nh);

}  // namespace ground
