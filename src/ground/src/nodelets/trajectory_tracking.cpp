#include <ground/TrajectoryTrackingConfig.h>

#include <pluginlib/class_list_macros.hpp>

#include "ground/nodelets/reference_tracking.h"

namespace ground {

/// Tracks a reference by backstepping (thesis 4.2). Parameters: those of ReferenceTracking, and
/// gains.
class TrajectoryTracking : public ReferenceTracking<TrajectoryTrackingConfig> {
 public:
  TrajectoryTracking() : ReferenceTracking("TrajectoryTracking") {}
  ~TrajectoryTracking() override { shutdown(); }
};

}  // namespace ground

PLUGINLIB_EXPORT_CLASS(ground::TrajectoryTracking, nodelet::Nodelet)
