#include <ground/ModelPredictiveConfig.h>

#include <pluginlib/class_list_macros.hpp>

#include "ground/nodelets/reference_tracking.h"

namespace ground {

/// Tracks a reference by nonlinear model predictive control with the whole model, effects included.
/// Parameters: those of ReferenceTracking, horizon, weights and the observer's noise.
class ModelPredictive : public ReferenceTracking<ModelPredictiveConfig> {
 public:
  ModelPredictive() : ReferenceTracking("ModelPredictive") {}
  ~ModelPredictive() override { shutdown(); }
};

}  // namespace ground

PLUGINLIB_EXPORT_CLASS(ground::ModelPredictive, nodelet::Nodelet)
