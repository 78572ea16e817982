// A mocap that repeats the last pose of a craft that it has lost.
#include "ground/estimation/frozen_pose.h"

#include <gtest/gtest.h>

namespace ground {
namespace frozen_pose_test {

FrozenPose::Pose pose(int n) { return {1e-6 * n, 0, 0, 1, 0, 0, 0}; }

TEST(FrozenPose, ARepeatedPoseIsLeftOutUntilAnotherComes) {
  FrozenPose watch;
  for (int i = 1; i < 200; ++i) ASSERT_FALSE(watch.repeats(pose(i)));
  for (int i = 0; i < 50; ++i) ASSERT_TRUE(watch.repeats(pose(199)));
  EXPECT_TRUE(watch.frozen());
  EXPECT_FALSE(watch.repeats(pose(200)));
  EXPECT_FALSE(watch.frozen());
  EXPECT_TRUE(watch.repeats(pose(200)));
}

TEST(FrozenPose, PosesWithoutNoiseMayRepeat) {
  FrozenPose watch;
  for (int i = 0; i < 500; ++i) ASSERT_FALSE(watch.repeats(pose(i / 10)));  // a craft at rest
}

}  // namespace frozen_pose_test
}  // namespace ground
