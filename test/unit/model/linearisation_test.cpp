// Normal equations of all windows, compared with those summed row by row for each window.
#include "../../../src/ground/src/identification/linearisation.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <mutex>
#include <numeric>

#include "../../../src/ground/src/identification/window_residuals.h"
#include "../artificial_run.h"
#include "ground/model/effect_registry.h"

namespace ground::detail {
namespace linearisation_test {

/// Windows of several lengths, from two runs. One run has
/// two samples at the same time. The model has a delay, a motor lag and a marker off the centre.
struct Problem {
  Model model = truth();
  std::vector<RunData> runs;
  std::vector<Window> windows;
  const std::vector<int> free = {2, 3, 4, 5, 6, 7, 8, 9};

  Problem() {
    for (const char* effect : {"input_delay", "motor_lag", "marker_offset"})
      model.addEffect(makeEffect(effect));
    model.setValue("input_delay.delay", 0.013);
    model.setValue("motor_lag.tau", 0.04);
    runs = {record(model, 5, 0.1, 1), record(model, 7, 0.1, 2)};
    runs[1].times[50] = runs[1].times[49];
    windows = cutWindows(runs[0], 0, 0, 1e9, 0.7);
    for (const Window& w : cutWindows(runs[1], 1, 0.3, 1e9, 0.6)) windows.push_back(w);
  }
  std::vector<Eigen::VectorXd> initial(const SimulationError& problem) const {
    std::vector<Eigen::VectorXd> states;
    for (std::size_t w = 0; w < windows.size(); ++w)
      states.push_back(0.1 * Eigen::VectorXd::LinSpaced(problem.initialSize(), -1, 1 + 0.1 * w));
    return states;
  }
};

/// Normal equations of a window's rows, summed directly.
NormalEquations sumRows(const WindowResiduals& rows, int columns, int first, int last,
                        const RobustLoss& robust) {
  NormalEquations sum{Eigen::MatrixXd::Zero(columns, columns), Eigen::VectorXd::Zero(columns)};
  for (int i = first; i < last; ++i) {
    const double r = rows.residuals(i), slope = robust.derivative(r);
    const Eigen::VectorXd row = rows.derivatives().row(i).head(columns);
    sum.A += slope * slope * row * row.transpose();
    sum.b += slope * robust(r) * row;
    sum.loss += robust(r) * robust(r);
  }
  return sum;
}

void expectSame(const NormalEquations& found, const NormalEquations& expected) {
  EXPECT_LE((found.A - expected.A).norm(), 1e-12 * expected.A.norm());
  EXPECT_LE((found.b - expected.b).norm(), 1e-11 * expected.b.norm());
  EXPECT_NEAR(found.loss, expected.loss, 1e-12 * expected.loss);
}

TEST(WindowResiduals, DerivativesAgreeWithFiniteDifferences) {
  const RunData run = record(truth(), 2, 0.1, 4);
  const SimulationError p = problem(run, 2);
  const Model model = with({8e-4, 4e-2, 6e-2, 8e-4, 0.12});
  const std::vector<int> free = {2, 3, 4, 5, 6, 0, 1};  // with the initial velocity: two passes
  const Vector3<double> nu(0.1, -0.05, 0.3);
  const WindowResiduals exact = residualsOf(p, model, model.coordinates(), free, 0, nu, true);
  ASSERT_TRUE(exact.finite());
  ASSERT_EQ(exact.columns, 10);
  for (int j = 0; j < 10; ++j) {
    std::vector<double> up = model.coordinates(), down = up;
    Vector3<double> nu_up = nu, nu_down = nu;
    double& a = j < 7 ? up[free[j]] : nu_up(j - 7);
    double& b = j < 7 ? down[free[j]] : nu_down(j - 7);
    const double h = 1e-5 * std::max(std::abs(a), 1e-3);
    a += h;
    b -= h;
    const WindowResiduals plus = residualsOf(p, model, up, {}, 0, nu_up, false);
    const WindowResiduals minus = residualsOf(p, model, down, {}, 0, nu_down, false);
    ASSERT_TRUE(plus.finite() && minus.finite());
    const Eigen::VectorXd finite = (plus.residuals - minus.residuals) / (2 * h);
    EXPECT_LT((exact.derivatives().col(j) - finite).norm(), 1e-5 * finite.norm() + 1e-9) << j;
  }
}

TEST(Linearisation, AgreesWithThatOfEachWindowAlone) {
  const Problem all;
  ASSERT_GT(all.windows.size(), 16u);
  for (const Target target : {Target::kVelocities, Target::kPoses}) {
    const SimulationError problem(all.runs, all.windows, target);
    const auto initial = all.initial(problem);
    const std::vector<double> at = all.model.coordinates();
    const int columns = static_cast<int>(all.free.size()) + problem.initialSize();
    Linearisation windows(problem, all.model, 2);
    for (const double delta : {kInfinity, 0.5})
      for (const int parts : {1, 3}) {
        std::mutex mutex;
        std::map<std::pair<int, int>, NormalEquations> found;
        windows.normalEquations(
            {at, all.free, initial}, RobustLoss{delta}.weighing(),
            [&](int window) { return window == 2 ? 1 : parts; },
            [&](int window, int part, const NormalEquations& equations) {
              const std::lock_guard<std::mutex> lock(mutex);
              EXPECT_TRUE(found.emplace(std::make_pair(window, part), equations).second);
            });
        const std::vector<double> losses =
            windows.losses({at, all.free, initial}, RobustLoss{delta}.weighing());
        std::size_t count = 0;
        for (int w = 0; w < static_cast<int>(all.windows.size()); ++w) {
          const WindowResiduals alone = residualsOf(problem, all.model, at, all.free, w, initial[w], true);
          ASSERT_TRUE(alone.finite());
          const int samples = static_cast<int>(alone.residuals.size()) / 3, in = w == 2 ? 1 : parts;
          double loss = 0;
          for (int part = 0; part < in; ++part, ++count) {
            ASSERT_EQ(found.count({w, part}), 1u);
            const NormalEquations expected =
                sumRows(alone, columns, 3 * (samples * part / in), 3 * (samples * (part + 1) / in), {delta});
            expectSame(found.at({w, part}), expected);
            loss += expected.loss;
          }
          EXPECT_NEAR(losses[w], loss, 1e-12 * loss);
        }
        EXPECT_EQ(found.size(), count);
      }
  }
}

TEST(Linearisation, ReportsWindowsThatAreNotFinite) {
  const Problem all;
  const SimulationError problem(all.runs, all.windows);
  auto initial = all.initial(problem);
  const std::vector<double> at = all.model.coordinates();
  initial[5](1) = 1e300;
  Linearisation windows(problem, all.model, 1);
  const auto weigh = RobustLoss{0.5}.weighing();
  const std::vector<double> losses = windows.losses({at, all.free, initial}, weigh);
  std::vector<bool> finite(losses.size());
  windows.normalEquations(
      {at, all.free, initial}, weigh, [](int) { return 1; },
      [&](int w, int, const NormalEquations& equations) {
        finite[w] = equations.A.allFinite() && equations.b.allFinite() && std::isfinite(equations.loss);
      });
  for (std::size_t w = 0; w < losses.size(); ++w) {
    EXPECT_EQ(std::isfinite(losses[w]), w != 5) << w;
    EXPECT_EQ(finite[w], w != 5) << w;
  }
}

}  // namespace linearisation_test
}  // namespace ground::detail
