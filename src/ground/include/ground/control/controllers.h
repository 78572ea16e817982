#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "ground/control/prbs.h"
#include "ground/control/predictive_control.h"
#include "ground/control/tracking_law.h"
#include "ground/model/tunable.h"

namespace ground {

/// A controller by its name, and what each kind takes.
struct ControllerChoice {
  std::string kind = "TrajectoryTracking";  ///< a name in controllerTable()
  TrackingGains gains;                      ///< TrajectoryTracking
  PredictiveParams predictive;              ///< ModelPredictive
  PrbsParams prbs;                          ///< OpenLoopPRBS
  int prbs_order = 9;                       ///< 2..20
  unsigned long prbs_seed = 1;

  std::string validate() const;  ///< what is wrong; empty when nothing is
};

/// What a kind of controller is, for all who offer, tune or make it.
struct ControllerInfo {
  std::string name, text;
  bool follows;  ///< a reference
  Tunables<ControllerChoice> parameters;
  /// What is wrong with its part of a choice; empty when nothing is.
  std::function<std::string(const ControllerChoice&)> validate;
  EffectUse (*effectUse)(const Model&);
  /// Throws std::invalid_argument when parameters are bad or it must not drive by this model.
  std::function<std::unique_ptr<TrackingController>(const Model&, const ControllerChoice&)> make;
  /// Hands good parameters to a controller that make() made.
  std::function<void(TrackingController&, const ControllerChoice&)> tune;
};

/// All kinds: OpenLoopPRBS, TrajectoryTracking, ModelPredictive.
const std::vector<ControllerInfo>& controllerTable();
/// Throws std::invalid_argument on an unknown kind.
const ControllerInfo& controllerInfo(const std::string& kind);
/// What a kind of controller does with the effects of a model; an open-loop one has no model.
EffectUse effectUse(const std::string& kind, const Model& model);
/// A controller that believes in `model`. Throws std::invalid_argument when parameters are bad or
/// when it must not drive by this model (effectUse).
std::unique_ptr<TrackingController> makeController(const Model& model,
                                                   const ControllerChoice& params);

}  // namespace ground
