#include <ground/ModelPredictiveConfig.h>

#include <pluginlib/class_list_macros.hpp>

#include "ground/control/predictive_control.h"
#include "ground/nodelets/observer_parameters.h"
#include "ground/nodelets/reference_tracking.h"

namespace ground {

/// Tracks a reference by nonlinear model predictive control on the whole model, effects included;
/// parameters as ReferenceTracking, and horizon, weights and the observer's noise.
class ModelPredictive : public ReferenceTracking<ModelPredictiveConfig> {
 public:
  ~ModelPredictive() override { shutdown(); }

 private:
  using Config = ModelPredictiveConfig;

  static PredictiveParams params(const Config& c) {
    PredictiveParams p;
    p.horizon = c.horizon;
    p.steps = c.steps;
    p.iterations = c.iterations;
    p.search_iterations = c.search_iterations;
    p.lost = c.lost;
    p.weights = {c.velocity, c.input, c.turning, c.end_position, c.end_velocity};
    p.observer = observerParams(c);
    return p;
  }

  const char* kind() const override { return "ModelPredictive"; }
  std::unique_ptr<TrackingController> make(const Model& model, const Config& c) override {
    return std::make_unique<PredictiveControl>(model, params(c));
  }
  std::string check(const Config& c) const override { return params(c).validate(); }
  void tune(TrackingController& controller, const Config& c) override {
    static_cast<PredictiveControl&>(controller).setParams(params(c));
  }
};

}  // namespace ground

PLUGINLIB_EXPORT_CLASS(ground::ModelPredictive, nodelet::Nodelet)
