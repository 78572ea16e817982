#pragma once

#include <regex>
#include <stdexcept>
#include <string>
#include <vector>

#include "ground/model/effect.h"
#include "ground/model/expression_effect.h"
#include "ground/model/shortened.h"

namespace ground {

/// What formulas of a model file may depend on: u, v, r, x, y, psi, the input of each thruster, lift, t,
/// volt. Each entry has all names of one argument.
inline std::vector<std::vector<std::string>> argumentNames(const ThrusterLayout& layout) {
  std::vector<std::vector<std::string>> names = {{"u"}, {"v"}, {"r"}, {"x"}, {"y"}, {"psi"}};
  for (int i = 0; i < layout.size(); ++i) {
    names.push_back({"u_" + layout[i].name, "u_" + std::to_string(i + 1)});
    if (layout.isPair()) names.back().push_back(i == 0 ? "u_L" : "u_R");
  }
  names.push_back({"lift"});
  names.push_back({"t"});
  names.push_back({"volt"});
  return names;
}

constexpr int kFirstInputArgument = 6;  ///< place of the first input in argumentNames

/// The value of argument number i of argumentNames.
template <typename T>
T argumentOf(const Point<T>& point, int i) {
  if (i < 3) return point.nu(i);
  if (i < kFirstInputArgument) return point.eta(i - 3);
  const int input = i - kFirstInputArgument, inputs = point.layout.size();
  if (input < inputs) return point.input(input);
  if (input > inputs + 1) return point.volts ? T(*point.volts) : T(point.body.volts);
  return input == inputs ? T(point.lift) : point.t;
}

inline bool isIdentifier(const std::string& text, std::size_t longest = kLongestName) {
  static const std::regex identifier("[A-Za-z][A-Za-z0-9_]*");
  return text.size() <= longest && std::regex_match(text, identifier);
}

/// Throws std::invalid_argument if the name of an effect in a model file is not an identifier.
inline void requireEffectName(const std::string& name) {
  if (!isIdentifier(name))
    throw std::invalid_argument("effect name '" + shortened(name) + "' is not an identifier of at most " +
                                std::to_string(kLongestName) + " characters");
}

}  // namespace ground
