#include "ground/estimation/frozen_pose.h"

#include <algorithm>

namespace ground {

bool FrozenPose::repeats(const Pose& pose) {
  const bool same = pose == last_;
  last_ = pose;
  frozen_ = same && distinct_ >= kMinDistinct;
  if (!same) distinct_ = std::min(distinct_ + 1, kMinDistinct);
  return frozen_;
}

}  // namespace ground
