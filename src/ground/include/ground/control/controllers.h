#pragma once

#include <memory>
#include <string>
#include <vector>

#include "ground/control/prbs.h"
#include "ground/control/predictive_control.h"
#include "ground/control/tracking_law.h"

namespace ground {

/// A controller by its name, and what each kind takes.
struct ControllerChoice {
  std::string kind = "TrajectoryTracking";  ///< or ModelPredictive, OpenLoopPRBS
  TrackingGains gains;                      ///< TrajectoryTracking
  PredictiveParams predictive;              ///< ModelPredictive
  PrbsParams prbs;                          ///< OpenLoopPRBS
  int prbs_order = 9;                       ///< 2..20
  unsigned long prbs_seed = 1;

  std::string validate() const;  ///< what is wrong; empty when nothing is
};

/// Names of all kinds.
const std::vector<std::string>& controllerNames();
/// What a kind of controller does with the effects of a model; an open-loop one has no model.
EffectUse effectUse(const std::string& kind, const Model& model);
/// A controller that believes in `model`. Throws std::invalid_argument when parameters are bad or
/// when it must not drive by this model (effectUse).
std::unique_ptr<TrackingController> makeController(const Model& model,
                                                   const ControllerChoice& params);

}  // namespace ground
