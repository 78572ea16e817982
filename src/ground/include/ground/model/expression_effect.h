#pragma once

#include <cstddef>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "ground/model/effect.h"

namespace ground {

constexpr std::size_t kLongestFormula = 1000;  ///< [characters]; 1000 of sines take 20 us a step
constexpr std::size_t kMaxEffectParameters = 32;
constexpr std::size_t kMaxEffectStates = 8;  ///< of one effect: one for each thruster
constexpr std::size_t kLongestName = 60;     ///< name of an effect or parameter [characters]

/// An effect written in the model file: wrench components as formulas (muparser) of
/// u, v, r, x, y, psi, u_L, u_R, lift, t, volt, pi, the effect's states and its parameters. It needs no
/// compiler. The input of a thruster is also u_NAME and u_NUMBER, counted from 1; only a left and a right
/// thruster are u_L and u_R.
struct ExpressionDefinition {
  /// A state and the formula of its time derivative, in the same variables. The state first settles
  /// to the commands before the start (Dynamics::settle), then is integrated with the motion
  /// (Dynamics::step).
  struct State {
    std::string name, rate;
    double initial = 0;  ///< value before the first command
  };

  std::string name;
  std::string X, Y, N;  ///< formulas [N], [N], [N m]; empty is zero
  std::vector<ParameterInfo> parameters;
  std::vector<double> typical;                   ///< scale of each parameter
  std::map<std::string, std::string> thrusts{};  ///< formulas of force added to thrusters, by name [N]
  std::vector<State> states{};
  bool world = false;  ///< X and Y are along the axes of the world, not of the body

  /// Names and texts of all formulas but the formulas of the states.
  std::vector<std::pair<std::string, std::string>> components() const {
    std::vector<std::pair<std::string, std::string>> all = {{"X", X}, {"Y", Y}, {"N", N}};
    for (const auto& [thruster, formula] : thrusts) all.emplace_back("thrust_" + thruster, formula);
    return all;
  }
};

/// For crafts with these thrusters. Throws std::invalid_argument that says which formula is wrong
/// and why, or which limit is exceeded.
EffectPtr makeExpressionEffect(const ExpressionDefinition& definition,
                               const ThrusterLayout& layout = *thrusterPair());
/// Throws std::invalid_argument if the derivative of a state is not finite at the given values of
/// the parameters. Does nothing for effects that are not expressions.
void requireFiniteRates(const Effect& effect, const std::vector<double>& values);
/// The definition of an expression effect, or nullptr for any other effect.
const ExpressionDefinition* expressionDefinition(const Effect& effect);

}  // namespace ground
