#include "formula_symbols.h"

#include <muParser.h>

#include <cmath>
#include <locale>
#include <sstream>
#include <stdexcept>

#include "ground/model/shortened.h"

namespace ground {
namespace {

Symbol symbolAt(double place) { return Trace::current().symbolAt(static_cast<int>(place)); }
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
    if (pair >= 0) throw mu::ParserError("? without :");
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

}  // namespace

Symbol symbolOf(const std::string& formula, const NamedSymbols& variables) {
  try {
    Tracer parser;
    for (const char* name : {"pi", "_pi"}) parser.DefineConst(name, placeOf(M_PI));
    parser.DefineConst("_e", placeOf(M_E));
    for (const auto& [name, symbol] : variables) parser.DefineConst(name, placeOf(symbol));
    parser.SetExpr(formula);
    return symbolAt(parser.Eval());
  } catch (const mu::ParserError& error) {
    throw std::invalid_argument("its formula '" + shortened(formula) +
                                "' cannot be written down: " + error.GetMsg());
  }
}

}  // namespace ground
