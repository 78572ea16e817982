#include "ground/model/expression_effect.h"

#include <muParser.h>

#include <algorithm>
#include <cmath>
#include <regex>
#include <set>
#include <stdexcept>

#include "ground/model/shortened.h"

namespace ground {
namespace {

/// Variables of a formula in the order of their values; parameters follow.
const std::vector<std::string>& variableNames() {
  static const std::vector<std::string> names = {"u",   "v",   "r",   "x",    "y",
                                                 "psi", "u_L", "u_R", "lift", "t"};
  return names;
}

bool isIdentifier(const std::string& text) {
  static const std::regex identifier("[A-Za-z][A-Za-z0-9_]*");
  return text.size() <= kLongestName && std::regex_match(text, identifier);
}

/// One formula bound to the values of an ExpressionEffect.
struct Formula {
  mu::Parser parser;
  std::vector<int> depends;  ///< indices of the values it uses
};

class ExpressionEffect final : public Effect {
 public:
  explicit ExpressionEffect(const ExpressionDefinition& definition) : definition_(definition) {
    info_.name = definition.name;
    info_.summary = "expression";
    info_.parameters = definition.parameters;
    for (std::size_t i = 0; i < info_.parameters.size(); ++i) {
      const double scale = definition.typical.at(i);
      info_.parameters[i].scale = [scale](const Body<double>&) { return scale; };
    }
    const int count = static_cast<int>(variableNames().size() + info_.parameters.size());
    values_.resize(count);
    for (int i = 0; i < 3; ++i)
      if (hasFormula(i)) bind("XYN"[i], text(i), formulas_[i]);
    if (!info_.parameters.empty()) checkNeutral();
  }

  const EffectInfo& info() const override { return info_; }
  unsigned hooks() const override { return kWrench | kPose; }
  EffectPtr forThread() const override { return std::make_shared<ExpressionEffect>(definition_); }
  const ExpressionDefinition& definition() const { return definition_; }

  void wrench(const double* p, const Point<double>& point, Vector3<double>& wrench) const override {
    add(p, point, wrench);
  }
  void wrench(const Jet* p, const Point<Jet>& point, Vector3<Jet>& wrench) const override {
    add(p, point, wrench);
  }
  void wrench(const Lanes* p, const Point<Lanes>& point, Vector3<Lanes>& wrench) const override {
    add(p, point, wrench);
  }
  void wrench(const LanesJet* p, const Point<LanesJet>& point,
              Vector3<LanesJet>& wrench) const override {
    add(p, point, wrench);
  }

 private:
  static int variableCount() { return static_cast<int>(variableNames().size()); }
  const std::string& text(int i) const {
    return i == 0 ? definition_.X : i == 1 ? definition_.Y : definition_.N;
  }
  bool hasFormula(int i) const { return !text(i).empty(); }

  template <typename T>
  static T variable(const Point<T>& point, int i) {
    switch (i) {
      case 0:
      case 1:
      case 2:
        return point.nu(i);
      case 3:
      case 4:
      case 5:
        return point.eta(i - 3);
      case 6:
      case 7:
        return point.input(i - 6);
      case 8:
        return T(point.lift);
      default:
        return point.t;
    }
  }

  template <typename T>
  void add(const T* p, const Point<T>& point, Vector3<T>& wrench) const {
    for (int lane = 0; lane < laneCount(T()); ++lane) {
      for (int j = 0; j < static_cast<int>(values_.size()); ++j)
        values_[j] = inLane(valueOf(argument(p, point, j)), lane);
      for (int i = 0; i < 3; ++i)
        if (hasFormula(i)) add(formulas_[i], p, point, lane, wrench(i));
    }
  }
  template <typename T>
  void add(const Formula& formula, const T* p, const Point<T>& point, int lane, T& sum) const {
    if constexpr (std::is_same_v<T, ValueOf<T>>) {
      inLane(sum, lane) += formula.parser.Eval();
    } else {
      inLane(sum.a, lane) += formula.parser.Eval();
      for (int j : formula.depends) {
        const T at = argument(p, point, j);
        if (at.isConstant()) continue;
        const double slope = derivative(formula, j);
        for (int d = 0; d < T::kDirections; ++d)
          inLane(sum.v[d], lane) += slope * inLane(at.v[d], lane);
      }
    }
  }
  template <typename T>
  static T argument(const T* p, const Point<T>& point, int j) {
    return j < variableCount() ? variable(point, j) : p[j - variableCount()];
  }

  template <typename T>
  static constexpr int laneCount(const T&) {
    return std::is_same_v<ValueOf<T>, Lanes> ? Lanes::kCount : 1;
  }
  static double& inLane(double& x, int) { return x; }
  static double inLane(const double& x, int) { return x; }
  static double& inLane(Lanes& x, int lane) { return x[lane]; }
  static double inLane(const Lanes& x, int lane) { return x[lane]; }

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
    return j < variableCount() ? 1.0 : std::abs(definition_.typical[j - variableCount()]);
  }

  [[noreturn]] void fail(char component, const std::string& text, const std::string& why) const {
    throw std::invalid_argument("effect '" + definition_.name + "': formula " + component + " = '" +
                                shortened(text) + "': " + shortened(why, 120));
  }

  void bind(char component, const std::string& text, Formula& formula) {
    if (text.size() > kLongestFormula)
      fail(component, text, "it is longer than " + std::to_string(kLongestFormula) + " characters");
    static const std::regex assignment("(^|[^<>=!])=([^=]|$)");
    if (std::regex_search(text, assignment)) fail(component, text, "it must not assign with '='");
    try {
      mu::Parser& parser = formula.parser;
      parser.DefineConst("pi", M_PI);
      for (int i = 0; i < variableCount(); ++i) parser.DefineVar(variableNames()[i], &values_[i]);
      for (std::size_t i = 0; i < info_.parameters.size(); ++i)
        parser.DefineVar(info_.parameters[i].name, &values_[variableCount() + i]);
      parser.SetExpr(text);
      int results = 0;
      parser.Eval(results);
      if (results != 1) fail(component, text, "it must give one number, not a list");
      for (const auto& used : parser.GetUsedVar())
        formula.depends.push_back(static_cast<int>(used.second - values_.data()));
    } catch (const mu::Parser::exception_type& error) {
      fail(component, text, error.GetMsg());
    }
  }

  /// An effect has to vanish at its neutral parameters, otherwise nothing can be compared to it.
  void checkNeutral() {
    for (std::size_t i = 0; i < info_.parameters.size(); ++i)
      values_[variableCount() + i] = info_.parameters[i].neutral;
    for (int trial = 0; trial < 8; ++trial) {
      for (int i = 0; i < variableCount(); ++i)  // off the special points 0 and 1
        values_[i] =
            (i < 6 ? 1.0 : 0.5) * std::sin(1.0 + 3.7 * trial + 1.3 * i) + (i < 6 ? 0 : 0.5);
      for (int i = 0; i < 3; ++i) {
        if (!hasFormula(i) || formulas_[i].parser.Eval() == 0.0) continue;
        fail("XYN"[i], text(i), "it is not zero at the neutral values of the parameters");
      }
    }
  }

  ExpressionDefinition definition_;
  EffectInfo info_;
  mutable std::vector<double> values_;  ///< of variables, then parameters; scratch of one thread
  Formula formulas_[3];
};

}  // namespace

EffectPtr makeExpressionEffect(const ExpressionDefinition& definition) {
  if (!isIdentifier(definition.name))
    throw std::invalid_argument("effect name '" + shortened(definition.name) +
                                "' is not an identifier of at most " +
                                std::to_string(kLongestName) + " characters");
  if (definition.X.empty() && definition.Y.empty() && definition.N.empty())
    throw std::invalid_argument("effect '" + definition.name + "' has none of X, Y, N");
  if (definition.parameters.size() > kMostEffectParameters)
    throw std::invalid_argument("effect '" + definition.name + "' has more than " +
                                std::to_string(kMostEffectParameters) + " parameters");
  std::set<std::string> names(variableNames().begin(), variableNames().end());
  names.insert("pi");
  for (const ParameterInfo& parameter : definition.parameters) {
    if (!isIdentifier(parameter.name) || !names.insert(parameter.name).second)
      throw std::invalid_argument("effect '" + definition.name + "': parameter name '" +
                                  shortened(parameter.name) + "' is taken or not an identifier");
  }
  return std::make_shared<ExpressionEffect>(definition);
}

const ExpressionDefinition* expressionDefinition(const Effect& effect) {
  const auto* expression = dynamic_cast<const ExpressionEffect*>(&effect);
  return expression ? &expression->definition() : nullptr;
}

}  // namespace ground
