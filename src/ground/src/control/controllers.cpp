#include "ground/control/controllers.h"

#include <algorithm>
#include <stdexcept>

namespace ground {
namespace {

/// Plays a binary sequence, whatever the state: what tracking is to be compared with.
class OpenLoop : public TrackingController {
 public:
  OpenLoop(const Model& model, const ControllerChoice& params)
      : input_max_(model.body.input_max),
        signal_(makePrbs(params.prbs_order, params.prbs_seed), params.prbs) {}
  bool follows() const override { return false; }
  Vector2<double> decide(const Observation& seen) override {
    return wanted_ = input_max_ * signal_.at(seen.now - seen.reference_start);
  }
  Vector2<double> wanted() const override { return wanted_; }

 private:
  double input_max_;
  PrbsSignal signal_;
  Vector2<double> wanted_ = Vector2<double>::Zero();
};

}  // namespace

const std::vector<std::string>& controllerNames() {
  static const std::vector<std::string> names = {"OpenLoopPRBS", "TrajectoryTracking",
                                                 "ModelPredictive"};
  return names;
}

std::string ControllerChoice::validate() const {
  const std::vector<std::string>& names = controllerNames();
  if (std::find(names.begin(), names.end(), kind) == names.end())
    return "the controller must be OpenLoopPRBS, TrajectoryTracking or ModelPredictive, not '" +
           kind + "'";
  for (const std::string& wrong : {gains.validate(), predictive.validate(), prbs.validate()})
    if (!wrong.empty()) return wrong;
  return "";
}

EffectUse effectUse(const std::string& kind, const Model& model) {
  if (kind == "TrajectoryTracking") return BacksteppingControl::effectUse(model);
  if (kind == "ModelPredictive") return PredictiveControl::effectUse(model);
  return {};
}

std::unique_ptr<TrackingController> makeController(const Model& model,
                                                   const ControllerChoice& params) {
  const std::string wrong = params.validate();
  if (!wrong.empty()) throw std::invalid_argument(wrong);
  if (params.kind == "ModelPredictive")
    return std::make_unique<PredictiveControl>(model, params.predictive);
  if (params.kind == "OpenLoopPRBS") return std::make_unique<OpenLoop>(model, params);
  return std::make_unique<BacksteppingControl>(model, params.gains);
}

}  // namespace ground
