#include "forecast.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace ground {
namespace {

/// A root of a covariance that may be singular.
Matrix13 rootOf(const Matrix13& covariance) {
  const Eigen::LDLT<Matrix13> ldlt(covariance);
  const Matrix13 lower = ldlt.matrixL();
  const Vector13 root = ldlt.vectorD().cwiseMax(0).cwiseSqrt();
  const Matrix13 found = lower * root.asDiagonal();
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

/// Draws one motion; a row of x, y, psi, u, v, r as measured for each sample from the first on.
void drawMotion(const RunData& run, Model model, const DisturbanceLevels& levels,
                const Vector13& from, int first, Normal& normal,
                Eigen::Ref<Eigen::MatrixXd> rows) {
  model.body.k *= std::max(0.0, 1 + from(12));
  const Dynamics<double> dynamics(model);
  const Matrix3<double> mobility = dynamics.mass().inverse();
  const Vector3<double> noise = Vector3<double>(levels.position, levels.position, levels.heading)
                                    .cwiseProduct(run.noise);
  Simulation<double> simulation(dynamics, run.inputs, {from.head<3>(), from.segment<3>(3)},
                                run.times[static_cast<std::size_t>(first)]);
  Vector3<double> slow = from.segment<3>(6);  // the Ornstein-Uhlenbeck wrench
  for (Eigen::Index row = 0; row < rows.rows(); ++row) {
    const double time = run.times[static_cast<std::size_t>(first + row)];
    const double dt = time - simulation.time();
    if (dt > 0) {
      Vector3<double> wrench = from.segment<3>(9);
      for (int i = 0; i < 3; ++i) {
        const double part = dt / levels.time(i), left = std::exp(-part);
        const double next = left * slow(i) + levels.sigma(i) * std::sqrt(1 - left * left) * normal();
        wrench(i) += 0.5 * (slow(i) + next) + levels.white(i) / std::sqrt(dt) * normal();
        slow(i) = next;
      }
      const Vector3<double> push = 0.5 * dt * mobility * wrench;
      simulation.state().nu += push;  // half of it before the step, half after
      simulation.advance(time);
      simulation.state().nu += push;
    }
    const Measurement<double> seen = simulation.measure();
    rows.row(row).head<3>() = seen.eta + noise.cwiseProduct(normal.vector<3>());
    rows.row(row).tail<3>() = seen.nu;
  }
}

}  // namespace

Forecast forecastBy(const RunData& run, const Model& model,
                    const std::vector<Alternative>& alternatives, int last,
                    const ForecastOptions& options, std::mt19937_64& random) {
  const int first = alternatives.front().belief.sample;
  const Eigen::Index count = last - first + 1, draws = options.draws;
  std::vector<Matrix13> roots;
  for (const Alternative& one : alternatives) roots.push_back(rootOf(one.belief.covariance));
  Eigen::MatrixXd drawn(count, 6 * draws);  // channels of a draw beside each other
  Normal normal(random);
  std::size_t at = 0;
  double passed = 0;  // weight of the alternatives before
  for (Eigen::Index i = 0; i < draws; ++i) {
    const double share = (static_cast<double>(i) + 0.5) / static_cast<double>(draws);
    while (at + 1 < alternatives.size() && passed + alternatives[at].weight < share)
      passed += alternatives[at++].weight;
    const Alternative& one = alternatives[at];
    const Vector13 from = one.belief.mean + roots[at] * normal.vector<kFilterStates>();
    drawMotion(run, model, one.levels, from, first, normal, drawn.middleCols(6 * i, 6));
  }
  Forecast result{first, Eigen::MatrixXd(count, 6), Eigen::MatrixXd(count, 6),
                  Eigen::MatrixXd(count, 6), Eigen::MatrixXd(count, 6)};
  // Of `draws` motions and the real one any rank of the real one is equally likely.
  const auto outside = static_cast<Eigen::Index>(
      std::lround(0.5 * (1 - options.part) * (static_cast<double>(draws) + 1)));
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

}  // namespace ground
