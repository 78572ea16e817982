#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "ground/model/effect.h"

namespace ground {

// The formulas of a model are limited together, so that a step of it takes 0.1 ms at most, 2% of
// its 5 ms: 3000 characters of sines took 58 us.
constexpr std::size_t kLongestFormula = 1000;   ///< [characters]
constexpr std::size_t kLongestFormulas = 3000;  ///< of all effects of a model together [characters]
constexpr std::size_t kMostEffectParameters = 32;
constexpr std::size_t kLongestName = 60;  ///< of an effect and of a parameter [characters]

/// An effect written in the model file: wrench components as formulas (muparser) of
/// u, v, r, x, y, psi, u_L, u_R, lift, t, pi and its own parameters. No compiler needed; its
/// derivatives are central differences, those of all other effects are exact.
struct ExpressionDefinition {
  std::string name;
  std::string X, Y, N;  ///< formulas [N], [N], [N m], body; empty is zero
  std::vector<ParameterInfo> parameters;
  std::vector<double> typical;  ///< scale of each parameter

  std::size_t formulaLength() const { return X.size() + Y.size() + N.size(); }
};

/// Throws std::invalid_argument saying which formula is wrong and why, or which limit is passed.
EffectPtr makeExpressionEffect(const ExpressionDefinition& definition);
/// The definition of an effect made so, or nullptr for any other.
const ExpressionDefinition* expressionDefinition(const Effect& effect);

}  // namespace ground
