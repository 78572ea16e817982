#pragma once

#include <array>
#include <cstddef>
#include <string>
#include <vector>

#include "ground/model/effect.h"

namespace ground {

constexpr std::size_t kMaxArguments = 3;   ///< of a term
constexpr std::size_t kMaxCentres = 2000;  ///< of a term

/// A smooth function of some arguments: a sum of bells. The bell at centre c is (1 - d^2/9)^4, with
/// d the distance from c in widths: close to exp(-d^2/2), and zero from three widths on.
struct LearnedTerm {
  /// Among u, v, r, x, y, psi, the inputs of thrusters (u_NAME), lift, t: those of formulas.
  std::vector<std::string> arguments;
  /// Width of the bells along each argument, in its unit. The distance in psi is the chord
  /// 2 sin(dpsi/2), so that the function has a period of one turn.
  std::vector<double> widths;
  bool world = false;       ///< X and Y are along the axes of the world, not of the body
  Eigen::MatrixXd centres;  ///< (bells, arguments)
  /// X, Y [N], N [N m] at the top of each bell, (bells); an empty one means zero.
  std::array<std::vector<double>, 3> weights;
};

/// A stand-in for an effect without a name: a wrench that was learned from data and is written in the
/// model file as numbers. It is zero away from the data, and it vanishes at scale 0.
struct LearnedWrench {
  std::string name = "learned_wrench";
  std::vector<LearnedTerm> terms;
};

/// Throws std::invalid_argument that says what is wrong with a term, for crafts with these thrusters.
void validate(const LearnedTerm& term, const ThrusterLayout& layout);
/// Throws std::invalid_argument as validate does, or if the name or the number of terms is wrong.
EffectPtr makeLearnedWrench(const LearnedWrench& definition, const ThrusterLayout& layout = *thrusterPair());
/// The definition of a learned wrench, or nullptr for any other effect.
const LearnedWrench* learnedWrench(const Effect& effect);
/// Values of a term's bells, by which its weights are multiplied, at rows of arguments: (rows, bells).
/// Throws std::invalid_argument as validate does, or if the number of columns is wrong.
Eigen::MatrixXd bells(const LearnedTerm& term, const Eigen::MatrixXd& rows,
                      const ThrusterLayout& layout = *thrusterPair());

}  // namespace ground
