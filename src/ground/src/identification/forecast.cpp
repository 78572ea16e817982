#include "forecast.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "filter_steps.h"
#include "ground/model/random_wrench.h"

namespace ground::detail {
namespace {

/// Square root of a covariance that may be singular.
FilterMatrix rootOf(const FilterMatrix& covariance) {
  const Eigen::LDLT<FilterMatrix> ldlt(covariance);
  const FilterMatrix lower = ldlt.matrixL();
  const FilterVector root = ldlt.vectorD().cwiseMax(0).cwiseSqrt();
  const FilterMatrix found = lower * root.asDiagonal();
  return ldlt.transpositionsP().transpose() * found;
}

class Normal {
 public:
  explicit Normal(std::mt19937_64& random) : random_(random) {}
  double operator()() { return normal_(random_); }
  template <int kSize>
  Eigen::Matrix<double, kSize, 1> vector() {
    Eigen::Matrix<double, kSize, 1> drawn;
    for (int i = 0; i < kSize; ++i) drawn(i) = normal_(random_);
    return drawn;
  }

 private:
  std::mt19937_64& random_;
  std::normal_distribution<double> normal_;
};

using Processes = Random::Processes;

/// Draws one motion; a row of x, y, psi, u, v, r for each sample from the first on.
void drawMotion(const RunData& run, Model model, const Random& random, const FilterVector& from, int first,
                Normal& normal, Eigen::Ref<Eigen::MatrixXd> rows) {
  model.body.k *= std::max(0.0, 1 + from(kThrust));
  const Dynamics<double> dynamics(model, run.payload);
  const Matrix3<double> mobility = dynamics.mass().inverse();
  const Motion measured = motionOf(run);
  Simulation<double> simulation(dynamics, run.inputs, {from.head<3>(), from.segment<3>(3)},
                                run.times[static_cast<std::size_t>(first)], 2 * dynamics.longestStep(),
                                &measured);
  Processes slow = from.segment<kProcesses>(kSlow).array();  // Ornstein-Uhlenbeck: X, Y, N, room x, room y
  const auto see = [&](Eigen::Index row) {
    const Measurement<double> seen = simulation.measure();
    rows.row(row) << seen.eta.transpose(), seen.nu.transpose();
  };
  see(0);
  const double* time = &run.times[static_cast<std::size_t>(first)];
  for (Eigen::Index row = 1; row < rows.rows(); ++row, ++time) {
    const double dt = time[1] - time[0];
    const Random::Step step = random.over(dt);
    const Processes next = step.left * slow + step.added.sqrt() * normal.vector<kProcesses>().array();
    const Processes mean = 0.5 * dt * (slow + next);
    const Vector3<double> impulse =
        dt * from.segment<3>(kConstant) + mean.head<3>().matrix() +
        std::sqrt(dt) * random.white.sqrt().matrix().cwiseProduct(normal.vector<3>());
    slow = next;
    advancePushed(simulation, time[1], mobility, impulse, mean.tail<2>().matrix());
    see(row);
  }
}

}  // namespace

Forecast forecastBy(const RunData& run, const std::vector<DrawnModel>& models,
                    const std::vector<Alternative>& alternatives, const Eigen::MatrixXd& sensitivity,
                    int last, const ForecastOptions& options, std::mt19937_64& random) {
  const int first = alternatives.front().belief.sample;
  const Eigen::Index count = last - first + 1;
  const auto draws = static_cast<Eigen::Index>(models.size());
  std::vector<FilterMatrix> roots;
  std::vector<Random> levels;
  for (const Alternative& one : alternatives) {
    roots.push_back(rootOf(one.belief.covariance));
    levels.emplace_back(one.levels, run.noise);
  }
  Eigen::MatrixXd drawn(count, 6 * draws);  // channels of a draw beside each other
  Normal normal(random);
  std::size_t at = 0;
  double passed = 0;  // total weight of the earlier alternatives
  for (Eigen::Index i = 0; i < draws; ++i) {
    const double share = (static_cast<double>(i) + 0.5) / static_cast<double>(draws);
    while (at + 1 < alternatives.size() && passed + alternatives[at].weight < share)
      passed += alternatives[at++].weight;
    const Alternative& one = alternatives[at];
    const DrawnModel& model = models[static_cast<std::size_t>(i)];
    FilterVector from = one.belief.mean + roots[at] * normal.vector<kFilterStates>();
    if (model.away.size() > 0) from += sensitivity * model.away;
    auto rows = drawn.middleCols(6 * i, 6);
    drawMotion(run, model.model, levels[at], from, first, normal, rows);
    // Bands are computed row by row, so one draw of the noise for all rows keeps them smooth.
    Eigen::Matrix<double, 6, 1> noise;
    noise << one.levels.position * run.noise(0), one.levels.position * run.noise(1),
        one.levels.heading * run.noise(2), options.velocity_noise;
    rows.rowwise() += noise.cwiseProduct(normal.vector<6>()).transpose();
  }
  Forecast result{first, Eigen::MatrixXd(count, 6), Eigen::MatrixXd(count, 6), Eigen::MatrixXd(count, 6),
                  Eigen::MatrixXd(count, 6)};
  // The real motion has every rank among the draws with equal probability, so a band between order
  // statistics has coverage `part` for any number of draws.
  const auto outside =
      static_cast<Eigen::Index>(std::lround(0.5 * (1 - options.part) * (static_cast<double>(draws) + 1)));
  std::vector<double> values(static_cast<std::size_t>(draws));
  for (Eigen::Index row = 0; row < count; ++row)
    for (int channel = 0; channel < 6; ++channel) {
      double sum = 0, square = 0;
      for (Eigen::Index i = 0; i < draws; ++i)
        sum += values[static_cast<std::size_t>(i)] = drawn(row, 6 * i + channel);
      const double mean = sum / static_cast<double>(draws);
      for (const double value : values) square += (value - mean) * (value - mean);
      const auto low = values.begin() + (outside - 1), high = values.end() - outside;
      std::nth_element(values.begin(), low, values.end());
      result.low(row, channel) = *low;
      std::nth_element(values.begin(), high, values.end());
      result.high(row, channel) = *high;
      result.mean(row, channel) = mean;
      result.deviation(row, channel) = std::sqrt(square / static_cast<double>(draws - 1));
    }
  return result;
}

}  // namespace ground::detail
