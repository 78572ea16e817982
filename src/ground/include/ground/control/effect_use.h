#pragma once

#include <string>
#include <vector>

#include "ground/model/model.h"

namespace ground {

/// What a tracking controller does with the effects of the model that it believes in. Effects at
/// their neutral parameters are not listed: they do nothing.
struct EffectUse {
  std::vector<std::string> used;    ///< names of effects
  std::vector<std::string> unused;  ///< left out, and not strong enough to be refused
  std::string refusal;  ///< why the controller must not drive by this model; empty when it may

  /// "uses motor_lag, wind"; "does not use motor_lag, wind"; empty without effects.
  std::string remark() const;
};

/// A controller that works on the whole model. It refuses a model whose effects have more than
/// kMostStates states.
EffectUse wholeModelUse(const Model& model);

/// A controller, of this name, that works on the rigid body alone. It refuses a model that says
/// that what is measured is far from what the controller takes it for, or that commands act late.
/// Beyond these bounds the tuned gains of the Tiny Whoover lose the thesis's references in
/// simulation; within them effects make no difference that noise does not make:
///   measured heading off by more than 0.05 rad,
///   tracked point off by more than 10 mm,
///   commands that act more than 20 ms late.
EffectUse bodyOnlyUse(const Model& model, const std::string& controller);

}  // namespace ground
