#include "ground/model/expression_effect.h"

#include <muParser.h>

#include <algorithm>
#include <cmath>
#include <regex>
#include <set>
#include <sstream>
#include <stdexcept>

#include "arguments.h"
#include "formula_symbols.h"
#include "ground/model/did_you_mean.h"
#include "ground/model/shortened.h"

namespace ground {
namespace {

/// One formula bound to the values of an ExpressionEffect.
struct Formula {
  std::string what;  ///< "formula X", "state p"
  std::string text;  ///< empty: zero
  mu::Parser parser;
  std::vector<int> depends;  ///< indices of the values it uses
};

class ExpressionEffect final : public Effect {
 public:
  ExpressionEffect(const ExpressionDefinition& definition, const ThrusterLayout& layout)
      : definition_(definition), layout_(layout), variables_(argumentNames(layout)) {
    info_.name = definition.name;
    info_.parameters = definition.parameters;
    for (std::size_t i = 0; i < info_.parameters.size(); ++i) {
      const double scale = definition.typical.at(i);
      info_.parameters[i].scale = [scale](const Body<double>&) { return scale; };
    }
    info_.states = static_cast<int>(definition.states.size());
    for (const ExpressionDefinition::State& state : definition.states) info_.initial.push_back(state.initial);
    values_.resize(static_cast<std::size_t>(firstParameter()) + info_.parameters.size());
    for (const auto& [name, text] :
         {std::make_pair("X", definition.X), {"Y", definition.Y}, {"N", definition.N}})
      wrench_.push_back(bound(std::string("formula ") + name, text));
    for (const Thruster& one : layout.thrusters()) {
      const auto found = definition.thrusts.find(one.name);
      forces_.push_back(
          bound("formula thrust_" + one.name, found == definition.thrusts.end() ? "" : found->second));
    }
    for (const ExpressionDefinition::State& state : definition.states)
      rates_.push_back(bound("state " + state.name, state.rate));
    std::vector<double> neutral;
    for (const ParameterInfo& parameter : info_.parameters) neutral.push_back(parameter.neutral);
    requireFiniteRates(neutral);
    if (!neutral.empty()) requireZero(neutral);
  }

  const EffectInfo& info() const override { return info_; }
  unsigned hooks() const override {
    unsigned set = kPose;
    for (const Formula& formula : wrench_) set |= formula.text.empty() ? 0u : kWrench;
    for (const Formula& formula : forces_) set |= formula.text.empty() ? 0u : kThrust;
    return rates_.empty() ? set : set | kRates;
  }
  EffectPtr forThread() const override { return std::make_shared<ExpressionEffect>(definition_, layout_); }
  const ExpressionDefinition& definition() const { return definition_; }

#define GROUND_HOOKS_OF(T)                                                                  \
  void wrench(const T* p, const Point<T>& point, Vector3<T>& wrench) const override {       \
    Vector3<T> own(T(0.0), T(0.0), T(0.0));                                                 \
    add(p, point, wrench_.data(), 3, own.data());                                           \
    if (definition_.world) own.template head<2>() = point.heading.toBody({own(0), own(1)}); \
    for (int c = 0; c < 3; ++c) wrench(c) += own(c);                                        \
  }                                                                                         \
  void thrust(const T* p, const Point<T>& point, Thrusters<T>& force) const override {      \
    add(p, point, forces_.data(), force.size(), force.begin());                             \
  }                                                                                         \
  void rates(const T* p, const Point<T>& point, T* rates) const override {                  \
    std::fill(rates, rates + info_.states, T(0.0));                                         \
    add(p, point, rates_.data(), info_.states, rates);                                      \
  }
  GROUND_HOOKS_OF(double)
  GROUND_HOOKS_OF(Jet)
  GROUND_HOOKS_OF(Symbol)
#undef GROUND_HOOKS_OF

  /// Throws std::invalid_argument if the derivative of a state is not finite at these values of the
  /// parameters.
  void requireFiniteRates(const std::vector<double>& parameters) const {
    for (int trial = 0; trial < kTrials; ++trial) {
      tryAt(trial, parameters);
      for (const Formula& rate : rates_)
        if (!std::isfinite(rate.parser.Eval()))
          fail(rate, "its derivative by time is not finite at " + listed(parameters));
    }
  }

 private:
  static constexpr int kTrials = 8;

  int variableCount() const { return static_cast<int>(variables_.size()); }
  int firstParameter() const { return variableCount() + info_.states; }

  /// Adds the values of `count` formulas to `sums`.
  template <typename T>
  void add(const T* p, const Point<T>& point, const Formula* formulas, int count, T* sums) const {
    for (int j = 0; j < static_cast<int>(values_.size()); ++j) values_[j] = valueOf(argument(p, point, j));
    for (int i = 0; i < count; ++i) {
      if (formulas[i].text.empty()) continue;
      sums[i] += formulas[i].parser.Eval();
      if constexpr (!std::is_same_v<T, double>)
        for (int j : formulas[i].depends) {
          const T at = argument(p, point, j);
          if (!isConstant(at)) sums[i].v += derivative(formulas[i], j) * at.v;
        }
    }
  }
  void add(const Symbol* p, const Point<Symbol>& point, const Formula* formulas, int count,
           Symbol* sums) const {
    NamedSymbols names;
    for (int j = 0; j < static_cast<int>(values_.size()); ++j) {
      const Symbol at = argument(p, point, j);
      if (j < variableCount())
        for (const std::string& name : variables_[static_cast<std::size_t>(j)]) names.emplace_back(name, at);
      else if (j < firstParameter())
        names.emplace_back(definition_.states[static_cast<std::size_t>(j - variableCount())].name, at);
      else
        names.emplace_back(info_.parameters[static_cast<std::size_t>(j - firstParameter())].name, at);
    }
    for (int i = 0; i < count; ++i)
      if (!formulas[i].text.empty()) sums[i] += symbolOf(formulas[i].text, names);
  }
  template <typename T>
  T argument(const T* p, const Point<T>& point, int j) const {
    if (j < variableCount()) return argumentOf(point, j);
    return j < firstParameter() ? point.states[j - variableCount()] : p[j - firstParameter()];
  }

  double derivative(const Formula& formula, int j) const {
    const double at = values_[j];
    const double step = 6e-6 * std::max(std::abs(at), stepScale(j));  // cube root of the precision
    values_[j] = at + step;
    const double above = formula.parser.Eval();
    values_[j] = at - step;
    const double below = formula.parser.Eval();
    values_[j] = at;
    return (above - below) / (2 * step);
  }

  double stepScale(int j) const {
    return j < firstParameter() ? 1.0 : std::abs(definition_.typical[j - firstParameter()]);
  }

  [[noreturn]] void fail(const Formula& formula, const std::string& why) const {
    throw std::invalid_argument("effect '" + definition_.name + "': " + formula.what + " = '" +
                                shortened(formula.text) + "': " + shortened(why, 400));
  }

  [[noreturn]] void failUnknown(const Formula& formula, const std::string& word) const {
    std::vector<std::string> known;
    for (const auto& names : variables_) known.push_back(names.front());
    for (const auto& state : definition_.states) known.push_back(state.name);
    for (const ParameterInfo& parameter : info_.parameters) known.push_back(parameter.name);
    std::string text = "there is no " + shortened(word) + didYouMean(word, known) + "; there are";
    for (const std::string& name : known) text += " " + name;
    fail(formula, text);
  }

  Formula bound(const std::string& what, const std::string& text) {
    Formula formula{what, text, {}, {}};
    if (text.empty()) return formula;
    if (text.size() > kLongestFormula)
      fail(formula, "it is longer than " + std::to_string(kLongestFormula) + " characters");
    static const std::regex assignment("(^|[^<>=!])=([^=]|$)");
    if (std::regex_search(text, assignment)) fail(formula, "it must not assign with '='");
    try {
      mu::Parser& parser = formula.parser;
      parser.DefineConst("pi", M_PI);
      double* value = values_.data();
      for (const auto& names : variables_) {
        for (const std::string& name : names) parser.DefineVar(name, value);
        ++value;
      }
      for (const auto& state : definition_.states) parser.DefineVar(state.name, value++);
      for (const ParameterInfo& parameter : info_.parameters) parser.DefineVar(parameter.name, value++);
      parser.SetExpr(text);
      int results = 0;
      parser.Eval(results);
      if (results != 1) fail(formula, "it must give one number, not a list");
      std::set<int> depends;
      for (const auto& used : parser.GetUsedVar())
        depends.insert(static_cast<int>(used.second - values_.data()));
      formula.depends.assign(depends.begin(), depends.end());
    } catch (const mu::Parser::exception_type& error) {
      if (error.GetCode() == mu::ecUNASSIGNABLE_TOKEN) failUnknown(formula, error.GetToken());
      fail(formula, error.GetMsg());
    }
    return formula;
  }

  /// Sets the variables and states to the values of a trial, away from the special points 0 and 1.
  void tryAt(int trial, const std::vector<double>& parameters) const {
    for (int i = 0; i < firstParameter(); ++i) {
      const bool input = i >= kFirstInputArgument && i < variableCount();
      const double wave = std::sin(1.0 + 3.7 * trial + 1.3 * i);
      values_[i] = input ? 0.5 + 0.5 * wave : wave;
    }
    std::copy(parameters.begin(), parameters.end(), values_.begin() + firstParameter());
  }

  /// An effect must vanish at its neutral parameters, so that models with and without it compare.
  void requireZero(const std::vector<double>& neutral) const {
    for (int trial = 0; trial < kTrials; ++trial) {
      tryAt(trial, neutral);
      for (const auto* formulas : {&wrench_, &forces_})
        for (const Formula& formula : *formulas) {
          if (formula.text.empty() || formula.parser.Eval() == 0.0) continue;
          fail(formula, "it is not zero at the neutral values of the parameters");
        }
    }
  }

  /// Parameter values for messages, such as "c = 0, tau = 0.2".
  std::string listed(const std::vector<double>& parameters) const {
    std::ostringstream text;
    for (std::size_t i = 0; i < parameters.size(); ++i)
      text << (i ? ", " : "") << info_.parameters[i].name << " = " << parameters[i];
    return parameters.empty() ? "some motion" : text.str();
  }

  ExpressionDefinition definition_;
  ThrusterLayout layout_;
  std::vector<std::vector<std::string>> variables_;  ///< names of each
  EffectInfo info_;
  mutable std::vector<double> values_;  ///< variables, states, parameters; scratch of one thread
  std::vector<Formula> wrench_;         ///< X, Y, N
  std::vector<Formula> forces_;         ///< force added to each thruster
  std::vector<Formula> rates_;          ///< derivatives of the states
};

}  // namespace

EffectPtr makeExpressionEffect(const ExpressionDefinition& definition, const ThrusterLayout& layout) {
  requireEffectName(definition.name);
  const auto require = [&](bool condition, const std::string& message) {
    if (!condition) throw std::invalid_argument("effect '" + definition.name + "'" + message);
  };
  const auto components = definition.components();
  require(!std::all_of(components.begin(), components.end(),
                       [](const auto& component) { return component.second.empty(); }),
          " has none of X, Y, N and no thrust of a thruster (thrust_NAME)");
  require(definition.parameters.size() <= kMaxEffectParameters,
          " has more than " + std::to_string(kMaxEffectParameters) + " parameters");
  require(definition.states.size() <= kMaxEffectStates,
          " has more than " + std::to_string(kMaxEffectStates) + " states");
  std::set<std::string> names = {"pi"};
  for (const auto& variable : argumentNames(layout)) names.insert(variable.begin(), variable.end());
  const auto take = [&](const std::string& what, const std::string& name) {
    require(isIdentifier(name) && names.insert(name).second,
            ": " + what + " name '" + shortened(name) + "' is taken or not an identifier");
  };
  for (const ParameterInfo& parameter : definition.parameters) take("parameter", parameter.name);
  for (const ExpressionDefinition::State& state : definition.states) {
    take("state", state.name);
    require(!state.rate.empty(), ": state " + state.name + " has no formula for its derivative");
    require(std::isfinite(state.initial), ": the initial value of state " + state.name + " is not finite");
  }
  return std::make_shared<ExpressionEffect>(definition, layout);
}

void requireFiniteRates(const Effect& effect, const std::vector<double>& values) {
  if (const auto* expression = dynamic_cast<const ExpressionEffect*>(&effect))
    expression->requireFiniteRates(values);
}

const ExpressionDefinition* expressionDefinition(const Effect& effect) {
  const auto* expression = dynamic_cast<const ExpressionEffect*>(&effect);
  return expression ? &expression->definition() : nullptr;
}

}  // namespace ground
