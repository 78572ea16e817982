#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "ground/model/symbol.h"
#include "ground/model/types.h"

namespace ground {

/// Formulas of a model file, ready to be computed: their operations in order, each only once. Derivatives are
/// exact; where a finite value has none, as a square root at 0, it is 0.
class FormulaTape {
 public:
  /// variables: all names of each. An empty formula is none. Throws mu::ParserError if one is wrong.
  FormulaTape(const std::vector<std::string>& formulas,
              const std::vector<std::vector<std::string>>& variables);

  /// Adds the value of each formula to its sum. argument(j): the value of variable j.
  template <typename T, class Arguments>
  void add(const Arguments& argument, T* sums) const {
    static thread_local std::vector<T> values;
    if (values.size() < steps_.size()) values.resize(steps_.size());
    T* out = values.data();
    for (const Step& step : steps_) compute(step, argument, values.data(), *out++);
    for (std::size_t i = 0; i < results_.size(); ++i)
      if (results_[i] >= 0) sums[i] += values[static_cast<std::size_t>(results_[i])];
  }

 private:
  enum class Kind { kNumber, kVariable, kPlus, kMinus, kTimes, kOver, kSin, kCos, kFunction };

  struct Step {
    Kind kind;
    int count = 0;                 ///< of arguments; the number of a variable
    int arguments[3] = {0, 0, 0};  ///< earlier steps
    double number = 0;
    Trace::Function function{nullptr, nullptr};
  };

  template <typename T, class Arguments>
  void compute(const Step& step, const Arguments& argument, const T* values, T& out) const {
    const T &a = values[step.arguments[0]], &b = values[step.arguments[1]];
    using std::cos;
    using std::sin;
    switch (step.kind) {
      case Kind::kNumber:
        out = T(step.number);
        break;
      case Kind::kVariable:
        out = argument(step.count);
        break;
      case Kind::kPlus:
        out = a + b;
        break;
      case Kind::kMinus:
        out = a - b;
        break;
      case Kind::kTimes:
        out = a * b;
        break;
      case Kind::kOver:
        out = a / b;
        break;
      case Kind::kSin:
        out = sin(a);
        break;
      case Kind::kCos:
        out = cos(a);
        break;
      case Kind::kFunction:
        out = call(step, values);
        break;
    }
  }
  template <typename T>
  T call(const Step& step, const T* values) const {
    if constexpr (std::is_same_v<T, Symbol>) {
      std::vector<Symbol> arguments;
      for (int i = 0; i < step.count; ++i) arguments.push_back(values[step.arguments[i]]);
      return Trace::current().of(names_[static_cast<std::size_t>(&step - steps_.data())], arguments);
    } else {
      double x[3] = {0, 0, 0};
      for (int i = 0; i < step.count; ++i) x[i] = valueOf(values[step.arguments[i]]);
      T result(step.function.value(x));
      if constexpr (!std::is_same_v<T, double>) {
        double slopes[3] = {0, 0, 0};
        if (step.function.slopes) step.function.slopes(x, result.a, slopes);
        for (int i = 0; i < step.count; ++i)
          if (slopes[i] != 0 && std::isfinite(slopes[i])) result.v += slopes[i] * values[step.arguments[i]].v;
      }
      return result;
    }
  }

  int push(const Step& step, const std::string& name = "");
  int push(const Operation& operation, const std::vector<int>& arguments);

  std::vector<Step> steps_;
  std::vector<std::string> names_;  ///< of the functions of steps_
  std::vector<int> results_;        ///< step of each formula; -1 for none
};

}  // namespace ground
