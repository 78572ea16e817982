#include "formula_tape.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <map>

#include "formula_symbols.h"

namespace ground {

FormulaTape::FormulaTape(const std::vector<std::string>& formulas,
                         const std::vector<std::vector<std::string>>& variables) {
  Trace trace;
  NamedSymbols named;
  for (std::size_t j = 0; j < variables.size(); ++j)
    for (const std::string& name : variables[j]) named.emplace_back(name, trace.variable(std::to_string(j)));
  for (const std::string& formula : formulas)
    results_.push_back(formula.empty() ? -1 : trace.placeOf(symbolOf(formula, named)));
  const std::vector<Operation>& operations = trace.operations();
  std::vector<bool> needed(operations.size(), false);
  for (const int place : results_)
    if (place >= 0) needed[static_cast<std::size_t>(place)] = true;
  for (std::size_t k = operations.size(); k-- > 1;)
    for (const int place : operations[k].arguments)
      if (needed[k]) needed[static_cast<std::size_t>(place)] = true;
  std::vector<int> step_of(operations.size(), -1);
  for (std::size_t k = 1; k < operations.size(); ++k) {
    if (!needed[k]) continue;
    std::vector<int> arguments;
    for (const int place : operations[k].arguments)
      arguments.push_back(step_of[static_cast<std::size_t>(place)]);
    step_of[k] = push(operations[k], arguments);
  }
  for (int& place : results_)
    if (place >= 0) place = step_of[static_cast<std::size_t>(place)];
}

int FormulaTape::push(const Step& step) {
  steps_.push_back(step);
  return static_cast<int>(steps_.size()) - 1;
}

int FormulaTape::push(const Operation& operation, const std::vector<int>& arguments) {
  static const std::map<std::string, Kind> kinds = {
      {"constant", Kind::kNumber}, {"symbol", Kind::kVariable}, {"+", Kind::kPlus},  {"-", Kind::kMinus},
      {"*", Kind::kTimes},         {"/", Kind::kOver},          {"sin", Kind::kSin}, {"cos", Kind::kCos}};
  const auto kind = kinds.find(operation.name);
  Step step{kind == kinds.end() ? Kind::kFunction : kind->second, static_cast<int>(arguments.size())};
  std::copy(arguments.begin(), arguments.end(), step.arguments);
  step.number = operation.value;
  if (step.kind == Kind::kVariable) step.count = std::stoi(operation.label);
  if (step.kind != Kind::kFunction) return push(step);
  step.value = Trace::function(operation.name);
  step.slopes = slopesOf(operation.name);
  if (operation.name != "pow") return push(step);
  // Small powers are products, as muParser computes them.
  constexpr int kMostFactors = 4;
  const Step exponent = steps_[static_cast<std::size_t>(arguments[1])];
  if (exponent.kind == Kind::kNumber)
    for (int power = 2; power <= kMostFactors; ++power)
      if (exponent.number == power) {
        int product = arguments[0];
        for (int i = 1; i < power; ++i) product = push({Kind::kTimes, 2, {product, arguments[0], 0}});
        return product;
      }
  return push(step);
}

/// Null for functions that are constant almost everywhere.
FormulaTape::Slopes FormulaTape::slopesOf(const std::string& name) {
#define GROUND_SLOPES(...)                                                          \
  []([[maybe_unused]] const double* x, [[maybe_unused]] double y, double* slopes) { \
    const double each[] = {__VA_ARGS__};                                            \
    std::copy(std::begin(each), std::end(each), slopes);                            \
  }
  static const std::map<std::string, Slopes> all = {
      {"neg", GROUND_SLOPES(-1.0)},
      {"abs", GROUND_SLOPES(x[0] < 0   ? -1.0
                            : x[0] > 0 ? 1.0
                                       : 0.0)},
      {"sqrt", GROUND_SLOPES(0.5 / y)},
      {"exp", GROUND_SLOPES(y)},
      {"log", GROUND_SLOPES(1 / x[0])},
      {"tan", GROUND_SLOPES(1 + y * y)},
      {"asin", GROUND_SLOPES(1 / std::sqrt(1 - x[0] * x[0]))},
      {"acos", GROUND_SLOPES(-1 / std::sqrt(1 - x[0] * x[0]))},
      {"atan", GROUND_SLOPES(1 / (1 + x[0] * x[0]))},
      {"sinh", GROUND_SLOPES(std::cosh(x[0]))},
      {"cosh", GROUND_SLOPES(std::sinh(x[0]))},
      {"tanh", GROUND_SLOPES(1 - y * y)},
      {"asinh", GROUND_SLOPES(1 / std::sqrt(x[0] * x[0] + 1))},
      {"acosh", GROUND_SLOPES(1 / std::sqrt(x[0] * x[0] - 1))},
      {"atanh", GROUND_SLOPES(1 / (1 - x[0] * x[0]))},
      {"pow", GROUND_SLOPES(x[1] * std::pow(x[0], x[1] - 1), y * std::log(x[0]))},
      {"atan2", GROUND_SLOPES(x[1] / (x[0] * x[0] + x[1] * x[1]), -x[0] / (x[0] * x[0] + x[1] * x[1]))},
      {"min", GROUND_SLOPES(x[1] < x[0] ? 0.0 : 1.0, x[1] < x[0] ? 1.0 : 0.0)},
      {"max", GROUND_SLOPES(x[0] < x[1] ? 0.0 : 1.0, x[0] < x[1] ? 1.0 : 0.0)},
      {"select", GROUND_SLOPES(0.0, x[0] != 0 ? 1.0 : 0.0, x[0] != 0 ? 0.0 : 1.0)},
  };
#undef GROUND_SLOPES
  const auto found = all.find(name);
  return found == all.end() ? nullptr : found->second;
}

}  // namespace ground
