#include "formula_tape.h"

#include <muParser.h>

#include <algorithm>
#include <cmath>
#include <locale>
#include <map>
#include <sstream>
#include <utility>

namespace ground {
namespace {

/// The pair of a conditional (see Tracer) has a negative place and no value.
Symbol symbolAt(double place) {
  if (place < 0) throw mu::ParserError("there is a ':' without its '?'");
  return Trace::current().symbolAt(static_cast<int>(place));
}
double placeOf(const Symbol& symbol) { return Trace::current().placeOf(symbol); }

Symbol numberOf(const Condition& condition) { return select(condition, 1.0, 0.0); }
Condition holds(const Symbol& number) { return number != 0.0; }

template <class F>
double one(const F& f, double x) {
  return placeOf(f(symbolAt(x)));
}
template <class F>
double two(const F& f, double x, double y) {
  return placeOf(f(symbolAt(x), symbolAt(y)));
}

/// Folds a list of arguments by an operation of two.
template <class F>
Symbol folded(const F& f, const double* x, int count) {
  Symbol all = symbolAt(x[0]);
  for (int i = 1; i < count; ++i) all = f(all, symbolAt(x[i]));
  return all;
}
Symbol sum(const double* x, int count) {
  return folded([](const Symbol& a, const Symbol& b) { return a + b; }, x, count);
}
Symbol call(const char* name, const Symbol& a, const Symbol& b) { return Trace::current().of(name, {a, b}); }

/// A number at the start of a text, as muParser reads it.
int readNumber(const char* text, int* position, double* place) {
  std::istringstream stream(text);
  stream.imbue(std::locale::classic());
  double number = 0;
  stream >> number;
  if (stream.fail()) return 0;
  *position +=
      static_cast<int>(stream.eof() ? stream.str().size() : static_cast<std::size_t>(stream.tellg()));
  *place = placeOf(number);
  return 1;
}

#define GROUND_UNARY(expression) \
  [](double x_) { return one([](const Symbol& x) { return Symbol(expression); }, x_); }
#define GROUND_BINARY(expression)                                                            \
  [](double x_, double y_) {                                                                 \
    return two([](const Symbol& x, const Symbol& y) { return Symbol(expression); }, x_, y_); \
  }

/// The grammar and the functions of formulas, where each value is a place in the Trace.
class Tracer final : public mu::ParserBase {
 public:
  Tracer() {
    EnableBuiltInOprt(false);
    AddValIdent(readNumber);
    InitCharSets();
    InitFun();
    InitOprt();
  }
  void InitCharSets() override {
    DefineNameChars("0123456789_abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ");
    DefineOprtChars("+-*/^<>=!&|?:");
    DefineInfixOprtChars("+-");
  }
  void InitConst() override {}
  void InitOprt() override {
    DefineInfixOprt("-", GROUND_UNARY(-x), mu::prINFIX, false);
    DefineInfixOprt("+", GROUND_UNARY(x), mu::prINFIX, false);
    DefineOprt("+", GROUND_BINARY(x + y), mu::prADD_SUB);
    DefineOprt("-", GROUND_BINARY(x - y), mu::prADD_SUB);
    DefineOprt("*", GROUND_BINARY(x * y), mu::prMUL_DIV);
    DefineOprt("/", GROUND_BINARY(x / y), mu::prMUL_DIV);
    DefineOprt("^", GROUND_BINARY(pow(x, y)), mu::prPOW, mu::oaRIGHT);
    DefineOprt("<", GROUND_BINARY(numberOf(x < y)), mu::prCMP);
    DefineOprt(">", GROUND_BINARY(numberOf(x > y)), mu::prCMP);
    DefineOprt("<=", GROUND_BINARY(numberOf(x <= y)), mu::prCMP);
    DefineOprt(">=", GROUND_BINARY(numberOf(x >= y)), mu::prCMP);
    DefineOprt("==", GROUND_BINARY(numberOf(x == y)), mu::prCMP);
    DefineOprt("!=", GROUND_BINARY(numberOf(x != y)), mu::prCMP);
    DefineOprt("&&", GROUND_BINARY(numberOf(holds(x) && holds(y))), mu::prLAND);
    DefineOprt("||", GROUND_BINARY(numberOf(holds(x) || holds(y))), mu::prLOR);
    // a ? b : c is a ? (b : c), two operators of the lowest precedence; the pair (b : c) has no value.
    DefineOprt(
        "?", [](double condition, double pair) { return chosen(condition, pair); }, 0, mu::oaRIGHT);
    DefineOprt(
        ":", [](double a, double b) { return paired(a, b); }, 0, mu::oaRIGHT);
  }
  void InitFun() override {
#define GROUND_FUNCTION(name) \
  DefineFun(#name, static_cast<mu::fun_type1>(GROUND_UNARY(Trace::current().of(#name, {x}))), false)
    GROUND_FUNCTION(sin);
    GROUND_FUNCTION(cos);
    GROUND_FUNCTION(tan);
    GROUND_FUNCTION(asin);
    GROUND_FUNCTION(acos);
    GROUND_FUNCTION(atan);
    GROUND_FUNCTION(sinh);
    GROUND_FUNCTION(cosh);
    GROUND_FUNCTION(tanh);
    GROUND_FUNCTION(asinh);
    GROUND_FUNCTION(acosh);
    GROUND_FUNCTION(atanh);
    GROUND_FUNCTION(exp);
    GROUND_FUNCTION(log);
    GROUND_FUNCTION(sqrt);
    GROUND_FUNCTION(abs);
    GROUND_FUNCTION(rint);
#undef GROUND_FUNCTION
    const auto unary = [this](const char* name, mu::fun_type1 f) { DefineFun(name, f, false); };
    unary("ln", GROUND_UNARY(log(x)));
    unary("log2", GROUND_UNARY(log(x) / M_LN2));
    unary("log10", GROUND_UNARY(log(x) / M_LN10));
    unary("sign", GROUND_UNARY(select(x < 0.0, -1.0, select(x > 0.0, 1.0, 0.0))));
    DefineFun("atan2", static_cast<mu::fun_type2>(GROUND_BINARY(call("atan2", x, y))), false);
    const auto list = [this](const char* name, mu::multfun_type f) { DefineFun(name, f, false); };
    list("sum", [](const double* x, int count) { return placeOf(sum(x, count)); });
    list("avg", [](const double* x, int count) { return placeOf(sum(x, count) / count); });
    list("min", [](const double* x, int count) {
      return placeOf(folded([](const Symbol& a, const Symbol& b) { return call("min", a, b); }, x, count));
    });
    list("max", [](const double* x, int count) {
      return placeOf(folded([](const Symbol& a, const Symbol& b) { return call("max", a, b); }, x, count));
    });
  }

 private:
  using Pairs = std::vector<std::pair<double, double>>;

  /// Pairs are negative values: -1 for the first.
  static double paired(double a, double b) {
    pairs().emplace_back(a, b);
    return -static_cast<double>(pairs().size());
  }
  static double chosen(double condition, double pair) {
    if (pair >= 0) throw mu::ParserError("there is a '?' without its ':'");
    const auto [a, b] = pairs()[static_cast<std::size_t>(-pair) - 1];
    if (b < 0) {  // a conditional in the middle: its own alternative comes first
      const auto [c, d] = pairs()[static_cast<std::size_t>(-b) - 1];
      return paired(chosen(condition, paired(a, c)), d);
    }
    return placeOf(select(holds(symbolAt(condition)), symbolAt(a), symbolAt(b)));
  }
  static Pairs& pairs() {
    static thread_local Pairs all;
    return all;
  }
};

#undef GROUND_UNARY
#undef GROUND_BINARY

/// A formula of a model file, written into the Trace of this thread. Throws mu::ParserError.
Symbol symbolOf(const std::string& formula, const std::vector<std::pair<std::string, Symbol>>& variables) {
  Tracer parser;
  for (const char* name : {"pi", "_pi"}) parser.DefineConst(name, placeOf(M_PI));
  parser.DefineConst("_e", placeOf(M_E));
  for (const auto& [name, symbol] : variables) parser.DefineConst(name, placeOf(symbol));
  parser.SetExpr(formula);
  int results = 0;
  const double place = *parser.Eval(results);
  if (results != 1) throw mu::ParserError("it must give one number, not a list");
  return symbolAt(place);
}

}  // namespace

FormulaTape::FormulaTape(const std::vector<std::string>& formulas,
                         const std::vector<std::vector<std::string>>& variables) {
  Trace trace;
  std::vector<std::pair<std::string, Symbol>> named;
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

int FormulaTape::push(const Step& step, const std::string& name) {
  steps_.push_back(step);
  names_.push_back(name);
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
  step.function = Trace::function(operation.name);
  if (operation.name != "pow") return push(step, operation.name);
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
  return push(step, operation.name);
}

}  // namespace ground
