#include "ground/model/expression_effect.h"

#include <muParser.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <regex>
#include <set>
#include <sstream>
#include <stdexcept>

#include "arguments.h"
#include "formula_tape.h"
#include "ground/model/did_you_mean.h"
#include "ground/model/shortened.h"

namespace ground {
namespace {

/// One formula of an ExpressionEffect.
struct Formula {
  std::string what;  ///< "formula X", "state p"
  std::string text;  ///< empty: zero
};

/// Those that one hook of the effect computes.
struct Formulas {
  std::vector<Formula> each;
  std::optional<FormulaTape> tape;

  bool any() const {
    return std::any_of(each.begin(), each.end(), [](const Formula& one) { return !one.text.empty(); });
  }
};

class ExpressionEffect final : public Effect {
 public:
  ExpressionEffect(const ExpressionDefinition& definition, const ThrusterLayout& layout)
      : definition_(definition), variables_(argumentNames(layout)) {
    info_.name = definition.name;
    info_.parameters = definition.parameters;
    for (std::size_t i = 0; i < info_.parameters.size(); ++i) {
      const double scale = definition.typical.at(i);
      info_.parameters[i].scale = [scale](const Body<double>&) { return scale; };
    }
    info_.states = static_cast<int>(definition.states.size());
    for (const ExpressionDefinition::State& state : definition.states) info_.initial.push_back(state.initial);
    names_ = variables_;
    for (const ExpressionDefinition::State& state : definition.states) names_.push_back({state.name});
    for (const ParameterInfo& parameter : info_.parameters) names_.push_back({parameter.name});
    for (const auto& [name, text] :
         {std::make_pair("X", definition.X), {"Y", definition.Y}, {"N", definition.N}})
      wrench_.each.push_back({std::string("formula ") + name, text});
    for (const Thruster& one : layout.thrusters()) {
      const auto found = definition.thrusts.find(one.name);
      forces_.each.push_back(
          {"formula thrust_" + one.name, found == definition.thrusts.end() ? "" : found->second});
    }
    for (const ExpressionDefinition::State& state : definition.states)
      rates_.each.push_back({"state " + state.name, state.rate});
    for (Formulas* formulas : {&wrench_, &forces_, &rates_}) prepare(*formulas);
    std::vector<double> neutral;
    for (const ParameterInfo& parameter : info_.parameters) neutral.push_back(parameter.neutral);
    requireFiniteRates(neutral);
    if (!neutral.empty()) requireZero(neutral);
  }

  const EffectInfo& info() const override { return info_; }
  unsigned hooks() const override {
    return kPose | (wrench_.any() ? kWrench : 0u) | (forces_.any() ? kThrust : 0u) |
           (rates_.each.empty() ? 0u : kRates);
  }
  const ExpressionDefinition& definition() const { return definition_; }

#define GROUND_HOOKS_OF(T)                                                                  \
  void wrench(const T* p, const Point<T>& point, Vector3<T>& wrench) const override {       \
    Vector3<T> own(T(0.0), T(0.0), T(0.0));                                                 \
    add(p, point, wrench_, own.data());                                                     \
    if (definition_.world) own.template head<2>() = point.heading.toBody({own(0), own(1)}); \
    for (int c = 0; c < 3; ++c) wrench(c) += own(c);                                        \
  }                                                                                         \
  void thrust(const T* p, const Point<T>& point, Thrusters<T>& force) const override {      \
    add(p, point, forces_, force.begin());                                                  \
  }                                                                                         \
  void rates(const T* p, const Point<T>& point, T* rates) const override {                  \
    std::fill(rates, rates + info_.states, T(0.0));                                         \
    add(p, point, rates_, rates);                                                           \
  }
  GROUND_HOOKS_OF(double)
  GROUND_HOOKS_OF(Jet)
  GROUND_HOOKS_OF(Symbol)
#undef GROUND_HOOKS_OF

  /// Throws std::invalid_argument if the derivative of a state is not finite at these values of the
  /// parameters.
  void requireFiniteRates(const std::vector<double>& parameters) const {
    eachTried(rates_, parameters, [&](const Formula& rate, double value) {
      if (!std::isfinite(value)) fail(rate, "its derivative by time is not finite at " + listed(parameters));
    });
  }

 private:
  static constexpr int kTrials = 8;

  int variableCount() const { return static_cast<int>(variables_.size()); }
  int firstParameter() const { return variableCount() + info_.states; }

  template <typename T>
  void add(const T* p, const Point<T>& point, const Formulas& formulas, T* sums) const {
    formulas.tape->add([&](int j) { return argument(p, point, j); }, sums);
  }
  template <typename T>
  T argument(const T* p, const Point<T>& point, int j) const {
    if (j < variableCount()) return argumentOf(point, j);
    return j < firstParameter() ? point.states[j - variableCount()] : p[j - firstParameter()];
  }

  [[noreturn]] void fail(const Formula& formula, const std::string& why) const {
    throw std::invalid_argument("effect '" + definition_.name + "': " + formula.what + " = '" +
                                shortened(formula.text) + "': " + shortened(why, 400));
  }

  [[noreturn]] void failUnknown(const Formula& formula, const std::string& word) const {
    std::vector<std::string> known;
    for (const auto& names : names_) known.push_back(names.front());
    std::string text = "there is no " + shortened(word) + didYouMean(word, known) + "; there are";
    for (const std::string& name : known) text += " " + name;
    fail(formula, text);
  }

  /// Throws std::invalid_argument if one of the formulas is wrong.
  void prepare(Formulas& formulas) const {
    std::vector<std::string> texts;
    for (const Formula& formula : formulas.each) {
      check(formula);
      texts.push_back(formula.text);
    }
    formulas.tape.emplace(texts, names_);
  }

  void check(const Formula& formula) const {
    if (formula.text.size() > kLongestFormula)
      fail(formula, "it is longer than " + std::to_string(kLongestFormula) + " characters");
    static const std::regex assignment("(^|[^<>=!])=([^=]|$)");
    if (std::regex_search(formula.text, assignment)) fail(formula, "it must not assign with '='");
    if (formula.text.empty()) return;
    try {
      FormulaTape({formula.text}, names_);
    } catch (const mu::ParserError& error) {
      if (error.GetCode() == mu::ecUNASSIGNABLE_TOKEN) failUnknown(formula, error.GetToken());
      fail(formula, error.GetMsg());
    }
  }

  /// Calls act(formula, its value) with trial values of the variables and states, away from the special
  /// points 0 and 1.
  template <class Act>
  void eachTried(const Formulas& formulas, const std::vector<double>& parameters, const Act& act) const {
    std::vector<double> found(formulas.each.size());
    for (int trial = 0; trial < kTrials; ++trial) {
      std::fill(found.begin(), found.end(), 0.0);
      formulas.tape->add(
          [&](int j) {
            if (j >= firstParameter()) return parameters[static_cast<std::size_t>(j - firstParameter())];
            const double wave = std::sin(1.0 + 3.7 * trial + 1.3 * j);
            return j >= kFirstInputArgument && j < variableCount() ? 0.5 + 0.5 * wave : wave;
          },
          found.data());
      for (std::size_t i = 0; i < found.size(); ++i) act(formulas.each[i], found[i]);
    }
  }

  /// An effect must vanish at its neutral parameters, so that models with and without it compare.
  void requireZero(const std::vector<double>& neutral) const {
    for (const Formulas* formulas : {&wrench_, &forces_})
      eachTried(*formulas, neutral, [&](const Formula& formula, double value) {
        if (value != 0.0) fail(formula, "it is not zero at the neutral values of the parameters");
      });
  }

  /// Parameter values for messages, such as "c = 0, tau = 0.2".
  std::string listed(const std::vector<double>& parameters) const {
    std::ostringstream text;
    for (std::size_t i = 0; i < parameters.size(); ++i)
      text << (i ? ", " : "") << info_.parameters[i].name << " = " << parameters[i];
    return parameters.empty() ? "some motion" : text.str();
  }

  ExpressionDefinition definition_;
  std::vector<std::vector<std::string>> variables_;  ///< names of each
  std::vector<std::vector<std::string>> names_;      ///< ... then of the states and of the parameters
  EffectInfo info_;
  Formulas wrench_;  ///< X, Y, N
  Formulas forces_;  ///< force added to each thruster
  Formulas rates_;   ///< derivatives of the states
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
