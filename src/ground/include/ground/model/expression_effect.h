#pragma once

#include <string>
#include <vector>

#include "ground/model/effect.h"

namespace ground {

/// An effect written in the model file: wrench components as formulas (muparser) of
/// u, v, r, x, y, psi, u_L, u_R, lift, t, pi and its own parameters. No compiler needed; its
/// derivatives are central differences, those of all other effects are exact.
struct ExpressionDefinition {
  std::string name;
  std::string X, Y, N;  ///< formulas [N], [N], [N m], body; empty is zero
  std::vector<ParameterInfo> parameters;
  std::vector<double> typical;  ///< scale of each parameter
};

/// Throws std::invalid_argument saying which formula is wrong and why.
EffectPtr makeExpressionEffect(const ExpressionDefinition& definition);
/// The definition of an effect made so, or nullptr for any other.
const ExpressionDefinition* expressionDefinition(const Effect& effect);

}  // namespace ground
