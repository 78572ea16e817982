#pragma once

#include <ros/time.h>

namespace ground {

/// From one instant to another [s], negative when the second is earlier. ros::Duration throws where
/// a senseless stamp is too far away, and toSec() alone rounds to a quarter of a microsecond.
inline double secondsBetween(const ros::Time& from, const ros::Time& to) {
  return (static_cast<double>(to.sec) - static_cast<double>(from.sec)) +
         1e-9 * (static_cast<double>(to.nsec) - static_cast<double>(from.nsec));
}

}  // namespace ground
