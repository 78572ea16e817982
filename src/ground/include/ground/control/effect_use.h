#pragma once

#include <string>
#include <vector>

#include "ground/model/model.h"

namespace ground {

/// How a tracking controller uses the effects of its internal model. Effects at their neutral
/// parameters are not listed, because they have no influence.
struct EffectUse {
  std::vector<std::string> used;    ///< names of effects
  std::vector<std::string> unused;  ///< effects that the controller ignores, weak enough to do so
  std::string refusal;              ///< why the controller must not drive by this model; empty if it may

  /// Text such as "uses motor_lag, wind" or "does not use motor_lag, wind"; empty without effects.
  std::string remark() const;
};

/// Effect use of a controller that uses the whole model. It refuses a model whose effects have more
/// than kMaxStates states.
EffectUse wholeModelUse(const Model& model);

/// Effect use of TrajectoryTracking, which uses only the rigid body. It refuses a
/// model in which measurements are far from the true state or commands act late. Beyond the
/// following bounds, the tuned gains of the Tiny Whoover lose the thesis's references in
/// simulation; within them, effects change the tracking error less than noise does:
///   measured heading off by more than 0.05 rad,
///   tracked point off by more than 10 mm,
///   commands that act more than 20 ms late.
EffectUse bodyOnlyUse(const Model& model);

}  // namespace ground
