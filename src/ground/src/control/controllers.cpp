#include "ground/control/controllers.h"

#include <stdexcept>

namespace ground {
namespace {

/// Description of a Control with its Params.
template <class Control, class Params>
ControllerInfo following(const std::string& name, const std::string& text) {
  using C = ControllerChoice;
  return {name,
          text,
          joined<C>(Params::table()),
          &Control::effectUse,
          [](const Model& model, const C& choice) -> std::unique_ptr<TrackingController> {
            return std::make_unique<Control>(model, choice);
          },
          [](TrackingController& controller, const C& choice) {
            static_cast<Control&>(controller).setParams(choice);
          }};
}

}  // namespace

const std::vector<ControllerInfo>& controllerTable() {
  static const std::vector<ControllerInfo> table = {
      following<BacksteppingControl, TrackingGains>("TrajectoryTracking",
                                                    "Backstepping on the rigid body (thesis 4.2)"),
      following<PredictiveControl, PredictiveParams>(
          "ModelPredictive", "Model predictive control on the whole model, effects included"),
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
