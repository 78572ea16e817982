#pragma once

#include <array>

namespace ground {

/// Detects a mocap that has lost the craft and repeats its last pose. Measured poses have noise and never
/// repeat exactly. Poses of a simulator without noise may, so a hundred poses must have differed before.
class FrozenPose {
 public:
  using Pose = std::array<double, 7>;  ///< position and orientation

  /// Call with every pose. Returns whether it repeats the one before, so that it must be left out.
  bool repeats(const Pose& pose);
  /// Whether the last pose did.
  bool frozen() const { return frozen_; }

 private:
  static constexpr int kMinDistinct = 100;

  Pose last_{};
  int distinct_ = 0;  ///< number of poses that differed from the one before
  bool frozen_ = false;
};

}  // namespace ground
