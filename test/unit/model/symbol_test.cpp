// Calculations that are written down give what the same calculations with numbers give.
#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <stdexcept>

#include "ground/model/types.h"

namespace ground {
namespace symbol_test {

/// Uses every function and branch that effects have.
template <typename T>
T calculation(const T& x, const T& y) {
  using std::abs;
  using std::cos;
  using std::exp;
  using std::log;
  using std::pow;
  using std::sin;
  using std::sqrt;
  using std::tanh;
  const T sum = x * y - 0.5 / (1.0 + x * x) + (-y) * 3.0;
  const T smooth = exp(-x) * sin(y) + cos(x * y) + log(2.0 + sum * sum) + tanh(sum) - sqrt(1.5 + sin(x));
  const T branch = select(x < y, abs(sum), notBelowZero(sum));
  const T lazy = choose(
      x > 0.5 && y <= 2.0, [&] { return T(pow(x, 2.5)); }, [&] { return T(smooth * y); });
  const T guarded = whereAbove(
      0.0, sum, [](const T& s) { return T(sqrt(s)); }, T(0.0));
  return smooth + branch * lazy - guarded;
}

TEST(Symbol, GivesValueAndDerivativeOfTheSameCalculation) {
  Trace trace;
  const Symbol x = trace.variable("x"), y = trace.variable("y");
  const Symbol written = calculation(x, y), by_x = trace.derivative(written, x);
  std::mt19937 random(2);
  std::uniform_real_distribution<double> number(-2, 2);
  for (int i = 0; i < 200; ++i) {
    const double a = number(random), b = number(random);
    const Jet expected = calculation(Jet(a, 0), Jet(b));
    const auto value = [&](const Symbol& of) { return trace.at(trace.at(of, x, a), y, b); };
    ASSERT_TRUE(value(written).isConstant());
    EXPECT_NEAR(value(written).value, calculation(a, b), 1e-12);
    EXPECT_NEAR(value(by_x).value, expected.v[0], 1e-9 * (1 + std::abs(expected.v[0])));
  }
}

TEST(Symbol, IsWrittenOnce) {
  Trace trace;
  const Symbol x = trace.variable("x");
  const Symbol first = sin(x) * 2.0;
  const std::size_t count = trace.operations().size();
  EXPECT_EQ((sin(x) * 2.0).place, first.place);
  EXPECT_EQ(trace.operations().size(), count);
}

TEST(Symbol, LeavesOutWhatChangesNothing) {
  Trace trace;
  const Symbol x = trace.variable("x"), y = trace.variable("y");
  for (const Symbol& same : {x + 0.0, 0.0 + x, x - 0.0, x * 1.0, 1.0 * x, x / 1.0, -(-x), 1.0 / (1.0 / x),
                             y + (x - y), select(y < 0.0, x, x), 0.0 * y + x, x + 0.0 / y})
    EXPECT_EQ(same.place, x.place);
  EXPECT_EQ((-1.0 * x).place, (-x).place);
  EXPECT_EQ((y + -x).place, (y - x).place);
  EXPECT_EQ((y - -x).place, (y + x).place);
  EXPECT_EQ((y - -2.0).place, (y + 2.0).place);
  EXPECT_EQ((y + -2.0).place, (y - 2.0).place);
  EXPECT_TRUE((x * y - x * y).isConstant());
  EXPECT_TRUE((sin(Symbol(1.0)) + 2.0).isConstant());
}

TEST(Symbol, CannotBeBranchedOn) {
  Trace trace;
  const Symbol x = trace.variable("x");
  EXPECT_THROW(static_cast<void>(x > 0.0 ? 1 : 2), std::invalid_argument);
  EXPECT_TRUE(bool(Symbol(1.0) > 0.0) && !bool(Symbol(1.0) < 0.0));
}

TEST(Symbol, DecidesByParametersAndLeavesThemInTheFormula) {
  Trace trace;
  const Symbol h = trace.variable("h"), p = trace.parameter("p", 2.0);
  const Symbol chosen = select(p > 50.0 * h, p * h + p, 1.0 / h);
  EXPECT_EQ(trace.at(chosen, h, 0).place, p.place);
  EXPECT_EQ(valueOf(p * 3.0), 6.0);
}

TEST(Symbol, NeedsATrace) { EXPECT_THROW(Trace::current(), std::logic_error); }

}  // namespace symbol_test
}  // namespace ground
