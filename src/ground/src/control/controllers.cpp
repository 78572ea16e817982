#include "ground/control/controllers.h"

#include <stdexcept>

namespace ground {
namespace {

/// Description of a Control that follows a reference, with its Params in ControllerChoice.
template <class Control, class Params>
ControllerInfo following(const std::string& name, const std::string& text, Params ControllerChoice::*params) {
  using C = ControllerChoice;
  return {name,
          text,
          lifted(params, Params::table()),
          &Control::effectUse,
          [params](const Model& model, const C& choice) {
            return std::make_unique<Control>(model, choice.*params);
          },
          [params](TrackingController& controller, const C& choice) {
            static_cast<Control&>(controller).setParams(choice.*params);
          }};
}

}  // namespace

const std::vector<ControllerInfo>& controllerTable() {
  static const std::vector<ControllerInfo> table = {
      following<BacksteppingControl>("TrajectoryTracking", "Backstepping on the rigid body (thesis 4.2)",
                                     &ControllerChoice::gains),
      following<PredictiveControl>("ModelPredictive",
                                   "Model predictive control on the whole model, effects included",
                                   &ControllerChoice::predictive),
  };
  return table;
}

const ControllerInfo& controllerInfo(const std::string& kind) {
  const ControllerInfo* const info = findNamed(controllerTable(), kind);
  if (!info)
    throw std::invalid_argument("the controller must be one of " + namesOf(controllerTable()) + ", not '" +
                                kind + "'");
  return *info;
}

EffectUse effectUse(const std::string& kind, const Model& model) {
  return controllerInfo(kind).effectUse(model);
}

std::unique_ptr<TrackingController> makeController(const Model& model, const ControllerChoice& params) {
  return controllerInfo(params.kind).make(model, params);
}

}  // namespace ground
