#pragma once

#include <memory>
#include <string>
#include <vector>

#include "ground/control/predictive_control.h"
#include "ground/control/tracking_law.h"
#include "ground/model/tunable.h"

namespace ground {

/// A controller by its name, and the parameters of each kind.
struct ControllerChoice : TrackingGains, PredictiveParams {
  std::string kind = "TrajectoryTracking";  ///< a name in controllerTable()
};

/// Description of a kind of controller.
struct ControllerInfo {
  std::string name, text;
  Tunables<ControllerChoice> parameters;
  EffectUse (*effectUse)(const Model&);
  /// Makes a controller. Throws std::invalid_argument if parameters are bad or it must not drive by
  /// this model.
  std::unique_ptr<TrackingController> (*make)(const Model&, const ControllerChoice&);
  /// Sets valid parameters of a controller that make() made.
  void (*tune)(TrackingController&, const ControllerChoice&);
};

/// All kinds: TrajectoryTracking, ModelPredictive.
const std::vector<ControllerInfo>& controllerTable();
/// Throws std::invalid_argument on an unknown kind.
const ControllerInfo& controllerInfo(const std::string& kind);
/// How a kind of controller uses the effects of a model.
EffectUse effectUse(const std::string& kind, const Model& model);
/// Makes a controller with `model` as its internal model. Throws std::invalid_argument if
/// parameters are bad or it must not drive by this model (effectUse).
std::unique_ptr<TrackingController> makeController(const Model& model, const ControllerChoice& params);

}  // namespace ground
