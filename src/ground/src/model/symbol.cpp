#include "ground/model/symbol.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <stdexcept>

namespace ground {
namespace {

thread_local Trace* innermost = nullptr;

/// What each operation computes from its arguments x, and the derivatives of its value y by them.
const std::map<std::string, Trace::Function>& functions() {
// clang-format off
#define GROUND_VALUE(expression) [](const double* x) { return double(expression); }
#define GROUND_SLOPES(...)                                                          \
  []([[maybe_unused]] const double* x, [[maybe_unused]] double y, double* slopes) { \
    const double each[] = {__VA_ARGS__};                                            \
    std::copy(std::begin(each), std::end(each), slopes);                            \
  }
  static const std::map<std::string, Trace::Function> all = {
      {"neg", {GROUND_VALUE(-x[0]), GROUND_SLOPES(-1.0)}},
      {"!", {GROUND_VALUE(!x[0]), nullptr}},
      {"abs", {GROUND_VALUE(std::abs(x[0])), GROUND_SLOPES(x[0] < 0 ? -1.0 : x[0] > 0 ? 1.0 : 0.0)}},
      {"sqrt", {GROUND_VALUE(std::sqrt(x[0])), GROUND_SLOPES(0.5 / y)}},
      {"exp", {GROUND_VALUE(std::exp(x[0])), GROUND_SLOPES(y)}},
      {"log", {GROUND_VALUE(std::log(x[0])), GROUND_SLOPES(1 / x[0])}},
      {"sin", {GROUND_VALUE(std::sin(x[0])), nullptr}},
      {"cos", {GROUND_VALUE(std::cos(x[0])), nullptr}},
      {"tan", {GROUND_VALUE(std::tan(x[0])), GROUND_SLOPES(1 + y * y)}},
      {"asin", {GROUND_VALUE(std::asin(x[0])), GROUND_SLOPES(1 / std::sqrt(1 - x[0] * x[0]))}},
      {"acos", {GROUND_VALUE(std::acos(x[0])), GROUND_SLOPES(-1 / std::sqrt(1 - x[0] * x[0]))}},
      {"atan", {GROUND_VALUE(std::atan(x[0])), GROUND_SLOPES(1 / (1 + x[0] * x[0]))}},
      {"sinh", {GROUND_VALUE(std::sinh(x[0])), GROUND_SLOPES(std::cosh(x[0]))}},
      {"cosh", {GROUND_VALUE(std::cosh(x[0])), GROUND_SLOPES(std::sinh(x[0]))}},
      {"tanh", {GROUND_VALUE(std::tanh(x[0])), GROUND_SLOPES(1 - y * y)}},
      {"asinh", {GROUND_VALUE(std::asinh(x[0])), GROUND_SLOPES(1 / std::sqrt(x[0] * x[0] + 1))}},
      {"acosh", {GROUND_VALUE(std::acosh(x[0])), GROUND_SLOPES(1 / std::sqrt(x[0] * x[0] - 1))}},
      {"atanh", {GROUND_VALUE(std::atanh(x[0])), GROUND_SLOPES(1 / (1 - x[0] * x[0]))}},
      {"rint", {GROUND_VALUE(std::rint(x[0])), nullptr}},
      {"+", {GROUND_VALUE(x[0] + x[1]), nullptr}},
      {"-", {GROUND_VALUE(x[0] - x[1]), nullptr}},
      {"*", {GROUND_VALUE(x[0] * x[1]), nullptr}},
      {"/", {GROUND_VALUE(x[0] / x[1]), nullptr}},
      {"pow", {GROUND_VALUE(std::pow(x[0], x[1])),
        GROUND_SLOPES(x[1] * std::pow(x[0], x[1] - 1), y * std::log(x[0]))}},
      {"atan2", {GROUND_VALUE(std::atan2(x[0], x[1])),
        GROUND_SLOPES(x[1] / (x[0] * x[0] + x[1] * x[1]), -x[0] / (x[0] * x[0] + x[1] * x[1]))}},
      {"min", {GROUND_VALUE(std::min(x[0], x[1])),
        GROUND_SLOPES(x[1] < x[0] ? 0.0 : 1.0, x[1] < x[0] ? 1.0 : 0.0)}},
      {"max", {GROUND_VALUE(std::max(x[0], x[1])),
        GROUND_SLOPES(x[0] < x[1] ? 0.0 : 1.0, x[0] < x[1] ? 1.0 : 0.0)}},
      {"<", {GROUND_VALUE(x[0] < x[1]), nullptr}},
      {">", {GROUND_VALUE(x[0] > x[1]), nullptr}},
      {"<=", {GROUND_VALUE(x[0] <= x[1]), nullptr}},
      {">=", {GROUND_VALUE(x[0] >= x[1]), nullptr}},
      {"==", {GROUND_VALUE(x[0] == x[1]), nullptr}},
      {"!=", {GROUND_VALUE(x[0] != x[1]), nullptr}},
      {"&&", {GROUND_VALUE(x[0] != 0 && x[1] != 0), nullptr}},
      {"||", {GROUND_VALUE(x[0] != 0 || x[1] != 0), nullptr}},
      {"select", {GROUND_VALUE(x[0] != 0 ? x[1] : x[2]),
        GROUND_SLOPES(0.0, x[0] != 0 ? 1.0 : 0.0, x[0] != 0 ? 0.0 : 1.0)}},
  };
#undef GROUND_VALUE
#undef GROUND_SLOPES
  // clang-format on
  return all;
}

bool isNumber(const Symbol& x, double number) { return x.isConstant() && x.value == number; }
bool areSame(const Symbol& x, const Symbol& y) {
  return x.place == y.place && (x.place || x.value == y.value);
}

using Symbols = std::vector<Symbol>;
using Rule = Symbol (*)(const Symbol& y, const Symbols& a, const Symbols& d);

/// The derivative of y, an operation with arguments a whose derivatives are d.
const std::map<std::string, Rule>& rules() {
#define GROUND_RULE(expression)                                                               \
  []([[maybe_unused]] const Symbol& y, [[maybe_unused]] const Symbols& a, const Symbols& d) { \
    return expression;                                                                        \
  }
  static const std::map<std::string, Rule> all = {
      {"+", GROUND_RULE(d[0] + d[1])},
      {"-", GROUND_RULE(d[0] - d[1])},
      {"neg", GROUND_RULE(-d[0])},
      {"*", GROUND_RULE(d[0] * a[1] + a[0] * d[1])},
      {"/", GROUND_RULE((d[0] - y * d[1]) / a[1])},
      {"select", GROUND_RULE(traced("select", {a[0], d[1], d[2]}))},
      {"abs", GROUND_RULE(select(a[0] < 0.0, -d[0], d[0]))},
      {"sqrt", GROUND_RULE(0.5 / y * d[0])},
      {"exp", GROUND_RULE(y * d[0])},
      {"log", GROUND_RULE(d[0] / a[0])},
      {"sin", GROUND_RULE(cos(a[0]) * d[0])},
      {"cos", GROUND_RULE(-sin(a[0]) * d[0])},
      {"tanh", GROUND_RULE((1.0 - y * y) * d[0])},
      {"pow", GROUND_RULE(y * (a[1] / a[0] * d[0] + log(a[0]) * d[1]))},
  };
#undef GROUND_RULE
  return all;
}

}  // namespace

Trace::Trace() : outer_(innermost), operations_(1) { innermost = this; }

Trace::~Trace() { innermost = outer_; }

Trace& Trace::current() {
  if (!innermost) throw std::logic_error("symbols are used without a Trace");
  return *innermost;
}

const Trace::Function& Trace::function(const std::string& name) { return functions().at(name); }

Symbol Trace::symbolAt(int place) const {
  const Operation& operation = operations_[index(place)];
  Symbol symbol(operation.value);
  if (operation.name != "constant") symbol.place = place;
  return symbol;
}

Symbol Trace::add(const Operation& operation) {
  const auto key = std::make_tuple(operation.name, operation.label, operation.arguments,
                                   operation.name == "constant" ? operation.value : 0.0);
  int place = static_cast<int>(operations_.size());
  // What is not a number is equal to every key.
  if (!std::isnan(std::get<double>(key))) place = places_.emplace(key, place).first->second;
  if (place == static_cast<int>(operations_.size())) operations_.push_back(operation);
  Symbol symbol(operation.value);
  symbol.place = place;
  return symbol;
}

int Trace::placeOf(const Symbol& x) {
  return x.place ? x.place : add({"constant", "", {}, true, x.value}).place;
}

Symbol Trace::of(const std::string& name, const std::vector<Symbol>& arguments) {
  if (const std::optional<Symbol> known = shorter(name, arguments)) return *known;
  double values[3] = {0, 0, 0};
  std::transform(arguments.begin(), arguments.end(), values, [&](const Symbol& x) { return valueOf(x); });
  const bool fixed =
      std::all_of(arguments.begin(), arguments.end(), [&](const Symbol& x) { return isFixed(x); });
  const double value = function(name).value(values);
  if (std::all_of(arguments.begin(), arguments.end(), [](const Symbol& x) { return x.isConstant(); }))
    return value;
  std::vector<int> places;
  for (const Symbol& x : arguments) places.push_back(placeOf(x));
  return add({name, "", places, fixed, value});
}

/// The algebra that keeps equations short: 0 and 1, signs, a + (b - a), and reciprocals of reciprocals.
std::optional<Symbol> Trace::shorter(const std::string& name, const std::vector<Symbol>& arguments) const {
  const Symbol& a = arguments.front();
  const Symbol& b = arguments.back();
  if (name == "neg" && is(a, "neg")) return argument(a, 0);
  if (name == "select" && a.isConstant()) return arguments[a.value != 0 ? 1 : 2];
  if (name == "select" && areSame(arguments[1], b)) return b;
  if (name == "+") return shorterSum(a, b);
  if (name == "-") return shorterDifference(a, b);
  if (name == "*") return shorterProduct(a, b);
  if (name == "/") return shorterQuotient(a, b);
  if (name == "!=" && isNumber(b, 0) && is(a, "select")) return shorterRelation(a);
  return std::nullopt;
}

std::optional<Symbol> Trace::shorterSum(const Symbol& a, const Symbol& b) const {
  if (isNumber(a, 0)) return b;
  if (isNumber(b, 0)) return a;
  if (b.isConstant() && b.value < 0) return a - Symbol(-b.value);
  if (is(b, "neg")) return a - argument(b, 0);
  if (is(b, "-") && areSame(argument(b, 1), a)) return argument(b, 0);
  return std::nullopt;
}

std::optional<Symbol> Trace::shorterDifference(const Symbol& a, const Symbol& b) const {
  if (isNumber(a, 0)) return -b;
  if (isNumber(b, 0)) return a;
  if (areSame(a, b)) return 0.0;
  if (b.isConstant() && b.value < 0) return a + Symbol(-b.value);
  if (is(b, "neg")) return a + argument(b, 0);
  return std::nullopt;
}

std::optional<Symbol> Trace::shorterProduct(const Symbol& a, const Symbol& b) const {
  if (isNumber(a, 0) || isNumber(b, 0)) return 0.0;
  if (isNumber(a, 1)) return b;
  if (isNumber(b, 1)) return a;
  if (isNumber(a, -1)) return -b;
  return std::nullopt;
}

std::optional<Symbol> Trace::shorterQuotient(const Symbol& a, const Symbol& b) const {
  if (isNumber(a, 0) && !isNumber(b, 0)) return 0.0;
  if (isNumber(b, 1)) return a;
  if (is(b, "/") && isNumber(argument(b, 0), 1)) return a * argument(b, 1);
  return std::nullopt;
}

/// Whether a relation that was made the number 1 or 0 is not 0.
std::optional<Symbol> Trace::shorterRelation(const Symbol& number) const {
  if (isNumber(argument(number, 1), 1) && isNumber(argument(number, 2), 0)) return argument(number, 0);
  return std::nullopt;
}

Symbol Trace::derivative(const Symbol& y, const Symbol& x) {
  Known known{{x.place, Symbol(1.0)}};
  return slope(y, x, known);
}

Symbol Trace::slope(const Symbol& y, const Symbol& x, Known& known) {
  if (isFixed(y)) return 0.0;
  const auto found = known.find(y.place);
  if (found != known.end()) return found->second;
  const Operation operation = operations_[index(y.place)];
  std::vector<Symbol> a, d;
  for (const int place : operation.arguments) a.push_back(symbolAt(place));
  const bool chooses = operation.name == "select";
  for (std::size_t i = 0; i < a.size(); ++i)
    d.push_back(chooses && i == 0 ? Symbol(0.0) : slope(a[i], x, known));
  const bool constant = std::all_of(d.begin(), d.end(), [](const Symbol& one) { return isNumber(one, 0); });
  const auto rule = rules().find(operation.name);
  if (!constant && rule == rules().end())
    throw std::invalid_argument("there is no rule for the derivative of " + operation.name);
  return known[y.place] = constant ? Symbol(0.0) : rule->second(y, a, d);
}

Symbol Trace::at(const Symbol& y, const Symbol& x, double number) {
  Known known;
  return replaced(y, x, number, known);
}

Symbol Trace::replaced(const Symbol& y, const Symbol& x, double number, Known& known) {
  if (y.place == x.place && !y.isConstant()) return number;
  if (y.isConstant()) return y;
  const auto found = known.find(y.place);
  if (found != known.end()) return found->second;
  const Operation operation = operations_[index(y.place)];
  const auto part = [&](std::size_t i) {
    return replaced(symbolAt(operation.arguments[i]), x, number, known);
  };
  const auto again = [&]() -> Symbol {
    if (operation.arguments.empty()) return y;
    std::vector<Symbol> arguments{part(0)};
    if (operation.name == "select" && isFixed(arguments[0])) return part(valueOf(arguments[0]) != 0 ? 1 : 2);
    for (std::size_t i = 1; i < operation.arguments.size(); ++i) arguments.push_back(part(i));
    return of(operation.name, arguments);
  };
  return known[y.place] = again();
}

Condition::operator bool() const {
  if (!holds_.isConstant())
    throw std::invalid_argument(
        "it branches on a value by if or ?:, where select() or choose() of ground/model/types.h can be "
        "written down as a formula");
  return holds_.value != 0;
}

}  // namespace ground
