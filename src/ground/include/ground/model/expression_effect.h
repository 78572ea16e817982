#pragma once

#include <cstddef>
#include <string>
#include <utility>
#include <vector>

#include "ground/model/effect.h"

namespace ground {

// The total length of a model's formulas is limited so that computing a step of 5 ms takes at most
// 0.1 ms. 3000 characters of sines took 58 us.
constexpr std::size_t kLongestFormula = 1000;   ///< one formula [characters]
constexpr std::size_t kLongestFormulas = 3000;  ///< all formulas of a model together [characters]
constexpr std::size_t kMaxEffectParameters = 32;
constexpr std::size_t kMaxEffectStates = 8;  ///< of one effect: one for each thruster
constexpr std::size_t kLongestName = 60;     ///< name of an effect or parameter [characters]

/// An effect written in the model file: wrench components as formulas (muparser) of
/// u, v, r, x, y, psi, u_L, u_R, lift, t, pi, the effect's states and its parameters. It needs no
/// compiler. Its derivatives are central differences; those of all other effects are exact. The
/// input of a thruster is also u_NAME and u_NUMBER, counted from 1; only a left and a right thruster
/// are u_L and u_R.
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
  std::vector<double> typical;         ///< scale of each parameter
  std::string thrust_L{}, thrust_R{};  ///< formulas of force added to each thruster [N]
  std::vector<State> states{};
  /// The same as thrust_L, thrust_R by the names of thrusters, for crafts that list them.
  std::vector<std::pair<std::string, std::string>> thrusts{};
  bool world = false;  ///< X and Y are along the axes of the world, not of the body

  /// Names and texts of all formulas other than those of the states.
  std::vector<std::pair<std::string, std::string>> components() const {
    std::vector<std::pair<std::string, std::string>> all = {
        {"X", X}, {"Y", Y}, {"N", N}, {"thrust_L", thrust_L}, {"thrust_R", thrust_R}};
    for (const auto& [thruster, formula] : thrusts) all.emplace_back("thrust_" + thruster, formula);
    return all;
  }
  std::size_t formulaLength() const;
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
