#pragma once

#include <Eigen/Core>
#include <map>
#include <optional>
#include <string>
#include <tuple>
#include <vector>

namespace ground {

/// A number whose value is not known yet: a model with this scalar (Dynamics<Symbol>) writes its
/// equations into the Trace of this thread instead of computing them. Like a double, a Symbol is not
/// initialised by default; zeroed memory is the constant 0.
struct Symbol {
  double value;  ///< of a constant
  int place;     ///< of its operation in the Trace; 0 for a constant

  Symbol() = default;
  Symbol(double constant) : value(constant), place(0) {}  // NOLINT: as numbers do

  bool isConstant() const { return place == 0; }
  Symbol operator-() const;
  Symbol& operator+=(const Symbol& y) { return *this = *this + y; }
  Symbol& operator-=(const Symbol& y) { return *this = *this - y; }
  Symbol& operator*=(const Symbol& y) { return *this = *this * y; }
  Symbol& operator/=(const Symbol& y) { return *this = *this / y; }
  friend Symbol operator+(const Symbol& x, const Symbol& y);
  friend Symbol operator-(const Symbol& x, const Symbol& y);
  friend Symbol operator*(const Symbol& x, const Symbol& y);
  friend Symbol operator/(const Symbol& x, const Symbol& y);
};

/// Whether a relation of symbols holds. It has no value that code can branch on: select() and choose()
/// write both branches down.
class Condition {
 public:
  explicit Condition(const Symbol& holds) : holds_(holds) {}
  const Symbol& symbol() const { return holds_; }
  /// Throws std::invalid_argument if the relation depends on more than constants.
  explicit operator bool() const;

 private:
  Symbol holds_;
};

/// One step of a calculation.
struct Operation {
  /// "constant", "symbol", an operator of C ("neg": the sign, "select": `?:`), a function of math.h
  /// ("abs", "min" and "max" for functions of doubles).
  std::string name;
  std::string label;           ///< name of a symbol
  std::vector<int> arguments;  ///< places of earlier operations
  bool fixed;                  ///< depends on parameters and constants only
  double value;                ///< with the parameters' values, if it is fixed
};

/// Calculations that Symbols have written down, each only once. A Trace receives the calculations of its
/// thread as long as it lives; traces may be nested.
class Trace {
 public:
  Trace();
  ~Trace();
  Trace(const Trace&) = delete;
  Trace& operator=(const Trace&) = delete;

  /// What an operation computes from its arguments, and the derivatives of its value by them; null for one
  /// that is constant almost everywhere, and for sums, products, quotients, sin and cos.
  struct Function {
    double (*value)(const double* x);
    void (*slopes)(const double* x, double y, double* slopes);
  };
  /// The Function of a name (Operation::name).
  static const Function& function(const std::string& name);

  /// The innermost Trace of this thread. Throws std::logic_error if there is none.
  static Trace& current();

  Symbol variable(const std::string& name) { return add({"symbol", name, {}, false, 0}); }
  Symbol parameter(const std::string& name, double value) { return add({"symbol", name, {}, true, value}); }
  /// A function or an operator (Operation::name) of some arguments, or what it simplifies to.
  Symbol of(const std::string& name, const std::vector<Symbol>& arguments);

  /// Derivative of y by a variable x. Throws std::invalid_argument if a function on the way has none
  /// here.
  Symbol derivative(const Symbol& y, const Symbol& x);
  /// y with a number instead of the variable x. Relations between parameters are decided by their
  /// values.
  Symbol at(const Symbol& y, const Symbol& x, double number);

  double valueOf(const Symbol& x) const { return x.place ? operations_[index(x.place)].value : x.value; }
  bool isFixed(const Symbol& x) const { return !x.place || operations_[index(x.place)].fixed; }
  /// Place of a symbol; a constant gets one.
  int placeOf(const Symbol& x);
  Symbol symbolAt(int place) const;
  /// The first one is not used.
  const std::vector<Operation>& operations() const { return operations_; }

 private:
  using Known = std::map<int, Symbol>;

  static std::size_t index(int place) { return static_cast<std::size_t>(place); }
  Symbol add(const Operation& operation);
  bool is(const Symbol& x, const char* name) const {
    return x.place && operations_[index(x.place)].name == name;
  }
  Symbol argument(const Symbol& x, std::size_t i) const {
    return symbolAt(operations_[index(x.place)].arguments[i]);
  }
  std::optional<Symbol> shorter(const std::string& name, const std::vector<Symbol>& arguments) const;
  std::optional<Symbol> shorterSum(const Symbol& a, const Symbol& b) const;
  std::optional<Symbol> shorterDifference(const Symbol& a, const Symbol& b) const;
  std::optional<Symbol> shorterProduct(const Symbol& a, const Symbol& b) const;
  std::optional<Symbol> shorterQuotient(const Symbol& a, const Symbol& b) const;
  std::optional<Symbol> shorterRelation(const Symbol& number) const;
  Symbol slope(const Symbol& y, const Symbol& x, Known& known);
  Symbol replaced(const Symbol& y, const Symbol& x, double number, Known& known);

  Trace* outer_;
  std::vector<Operation> operations_;
  std::map<std::tuple<std::string, std::string, std::vector<int>, double>, int> places_;
};

/// An operation in the Trace of this thread.
inline Symbol traced(const char* name, const std::vector<Symbol>& arguments) {
  return Trace::current().of(name, arguments);
}

inline Symbol Symbol::operator-() const { return traced("neg", {*this}); }
inline Symbol operator+(const Symbol& x, const Symbol& y) { return traced("+", {x, y}); }
inline Symbol operator-(const Symbol& x, const Symbol& y) { return traced("-", {x, y}); }
inline Symbol operator*(const Symbol& x, const Symbol& y) { return traced("*", {x, y}); }
inline Symbol operator/(const Symbol& x, const Symbol& y) { return traced("/", {x, y}); }

inline Condition operator<(const Symbol& x, const Symbol& y) { return Condition(traced("<", {x, y})); }
inline Condition operator>(const Symbol& x, const Symbol& y) { return Condition(traced(">", {x, y})); }
inline Condition operator<=(const Symbol& x, const Symbol& y) { return Condition(traced("<=", {x, y})); }
inline Condition operator>=(const Symbol& x, const Symbol& y) { return Condition(traced(">=", {x, y})); }
inline Condition operator==(const Symbol& x, const Symbol& y) { return Condition(traced("==", {x, y})); }
inline Condition operator!=(const Symbol& x, const Symbol& y) { return Condition(traced("!=", {x, y})); }
inline Condition operator&&(const Condition& a, const Condition& b) {
  return Condition(traced("&&", {a.symbol(), b.symbol()}));
}
inline Condition operator||(const Condition& a, const Condition& b) {
  return Condition(traced("||", {a.symbol(), b.symbol()}));
}
inline Condition operator!(const Condition& a) { return Condition(traced("!", {a.symbol()})); }

/// `a` where the condition holds, else `b`.
inline Symbol select(const Condition& condition, const Symbol& a, const Symbol& b) {
  return traced("select", {condition.symbol(), a, b});
}

inline Symbol abs(const Symbol& x) { return traced("abs", {x}); }
inline Symbol sqrt(const Symbol& x) { return traced("sqrt", {x}); }
inline Symbol exp(const Symbol& x) { return traced("exp", {x}); }
inline Symbol log(const Symbol& x) { return traced("log", {x}); }
inline Symbol sin(const Symbol& x) { return traced("sin", {x}); }
inline Symbol cos(const Symbol& x) { return traced("cos", {x}); }
inline Symbol tanh(const Symbol& x) { return traced("tanh", {x}); }
inline Symbol pow(const Symbol& base, const Symbol& exponent) { return traced("pow", {base, exponent}); }

}  // namespace ground

namespace Eigen {
template <>
struct NumTraits<ground::Symbol> : NumTraits<double> {
  using Real = ground::Symbol;
  using NonInteger = ground::Symbol;
  using Nested = ground::Symbol;
  enum { RequireInitialization = 1 };
};
}  // namespace Eigen
