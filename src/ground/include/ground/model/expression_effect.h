#pragma once

#include <cstddef>
#include <string>
#include <utility>
#include <vector>

#include "ground/model/effect.h"

namespace ground {

// The formulas of a model are limited together, so that a step of it takes 0.1 ms at most, 2% of
// its 5 ms: 3000 characters of sines took 58 us.
constexpr std::size_t kLongestFormula = 1000;   ///< [characters]
constexpr std::size_t kLongestFormulas = 3000;  ///< of all effects of a model together [characters]
constexpr std::size_t kMostEffectParameters = 32;
constexpr std::size_t kMostEffectStates = 4;  ///< of one effect
constexpr std::size_t kLongestName = 60;  ///< of an effect and of a parameter [characters]

/// An effect written in the model file: wrench components as formulas (muparser) of
/// u, v, r, x, y, psi, u_L, u_R, lift, t, pi, its own states and its own parameters. No compiler
/// needed; its derivatives are central differences, those of all other effects are exact.
struct ExpressionDefinition {
  /// A state and its derivative by time, a formula of the same. It is integrated with the motion
  /// (Dynamics::step), after it has settled to the commands before the start (Dynamics::settle).
  struct State {
    std::string name, rate;
    double initial = 0;  ///< before anything has been commanded
  };

  std::string name;
  std::string X, Y, N;  ///< formulas [N], [N], [N m], body; empty is zero
  std::vector<ParameterInfo> parameters;
  std::vector<double> typical;         ///< scale of each parameter
  std::string thrust_L{}, thrust_R{};  ///< formulas of what is added to the thrusters' force [N]
  std::vector<State> states{};

  /// What the formulas beside those of the states are called, and their texts.
  std::vector<std::pair<std::string, std::string>> components() const {
    return {{"X", X}, {"Y", Y}, {"N", N}, {"thrust_L", thrust_L}, {"thrust_R", thrust_R}};
  }
  std::size_t formulaLength() const;
};

/// Throws std::invalid_argument saying which formula is wrong and why, or which limit is passed.
EffectPtr makeExpressionEffect(const ExpressionDefinition& definition);
/// Throws std::invalid_argument when the derivative of a state is not finite at the given values of
/// the parameters. Effects of other kinds pass.
void requireFiniteRates(const Effect& effect, const std::vector<double>& values);
/// The definition of an effect made so, or nullptr for any other.
const ExpressionDefinition* expressionDefinition(const Effect& effect);

}  // namespace ground
