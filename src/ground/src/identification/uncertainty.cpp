#include "uncertainty.h"

#include <Eigen/Eigenvalues>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>

namespace ground {
namespace {

/// Normal equations of the free parameters and one window's initial state.
struct Normal {
  Eigen::MatrixXd A;
  Eigen::VectorXd b;

  explicit Normal(int n) : A(Eigen::MatrixXd::Zero(n, n)), b(Eigen::VectorXd::Zero(n)) {}
  Normal& operator+=(const Normal& other) {
    A += other.A;
    b += other.b;
    return *this;
  }
  Normal& operator-=(const Normal& other) {
    A -= other.A;
    b -= other.b;
    return *this;
  }
  /// Without the initial state, the last `k` unknowns: whatever it is, it follows along.
  Normal reduced(Eigen::Index k) const {
    const Eigen::Index n = b.size() - k;
    const auto state = A.bottomRightCorner(k, k).completeOrthogonalDecomposition();
    Normal result(static_cast<int>(n));
    result.A =
        A.topLeftCorner(n, n) - A.topRightCorner(n, k) * state.solve(A.bottomLeftCorner(k, n));
    result.b = b.head(n) - A.topRightCorner(n, k) * state.solve(b.tail(k));
    return result;
  }
};

}  // namespace

double deviationOf(std::vector<double> sizes) {
  const auto middle = sizes.begin() + sizes.size() / 2;
  std::nth_element(sizes.begin(), middle, sizes.end());
  return 1.4826 * *middle;
}

Uncertainty uncertainty(const SimulationError& problem, const Model& model, const Free& free,
                        const std::vector<double>& coordinates, const Initials& initial,
                        const Robust& robust, double block, int threads) {
  const int n = static_cast<int>(free.index.size());
  const Eigen::VectorXd scale = Eigen::Map<const Eigen::VectorXd>(free.scale.data(), n);
  const auto durationOf = [&problem](const Window& w) {
    const std::vector<double>& times = problem.runs()[w.run].times;
    return times[w.last] - times[w.first];
  };
  std::vector<Eigen::VectorXd> residuals(problem.windows().size());
  std::vector<Derivatives> jacobians(problem.windows().size());
  problem.residuals(model, coordinates, free.index, initial, true, threads,
                    [&](const WindowResiduals& found) {
                      if (!found.finite) return;
                      residuals[found.window] = found.residuals;
                      jacobians[found.window] =
                          found.derivatives.leftCols(n + problem.initialSize());
                      jacobians[found.window].leftCols(n) *= scale.asDiagonal();
                    });
  double total = 0;
  std::vector<double> sizes;
  for (std::size_t w = 0; w < problem.windows().size(); ++w) {
    if (residuals[w].size() == 0) continue;
    total += durationOf(problem.windows()[w]);
    for (double r : residuals[w]) sizes.push_back(std::abs(r));
  }
  // In short data blocks are shorter: a covariance of n parameters needs several times n of them.
  block = std::min(block, total / (4 * n));
  const double width = std::max(robust.delta, sizes.empty() ? 0 : 0.3 * deviationOf(sizes));

  Normal whole(n);
  std::vector<Normal> changes;  // of the whole when a block is left out
  for (std::size_t w = 0; w < problem.windows().size(); ++w) {
    const Window& span = problem.windows()[w];
    const int samples = static_cast<int>(residuals[w].size()) / 3;
    if (samples == 0) continue;
    const int count =
        std::min(samples, std::max(1, static_cast<int>(std::lround(durationOf(span) / block))));
    Normal window(n + problem.initialSize());
    std::vector<Normal> parts(count, window);
    for (int b = 0; b < count; ++b) {
      const int begin = 3 * (samples * b / count), end = 3 * (samples * (b + 1) / count);
      for (int i = begin; i < end; ++i) {
        const Eigen::VectorXd row = jacobians[w].row(i);
        const double r = residuals[w](i);
        parts[b].A += robust.curvature(r, width) * row * row.transpose();
        parts[b].b += robust.score(r) * row;
      }
      window += parts[b];
    }
    const Normal reduced = window.reduced(problem.initialSize());
    whole += reduced;
    for (const Normal& part : parts) {
      Normal rest = window;
      rest -= part;
      changes.push_back(count > 1 ? rest.reduced(problem.initialSize()) : Normal(n));
      changes.back() -= reduced;
    }
  }

  Uncertainty result;
  result.information = whole.A;
  result.blocks = static_cast<int>(changes.size());
  result.identified.assign(n, true);
  constexpr double kNothing = 1e-14, kNoDirection = 1e-10, kTakesPart = 1e-6;
  const double largest = whole.A.diagonal().maxCoeff();
  Eigen::VectorXd unit(n);
  for (int i = 0; i < n; ++i) {
    result.identified[i] = whole.A(i, i) > kNothing * largest;
    unit(i) = result.identified[i] ? 1 / std::sqrt(whole.A(i, i)) : 0;
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(unit.asDiagonal() * whole.A *
                                                             unit.asDiagonal());
  int first = 0;  // directions before it are not seen
  while (first < n && !(eigen.eigenvalues()(first) > kNoDirection * eigen.eigenvalues()(n - 1)))
    for (int i = 0, j = first++; i < n; ++i)
      if (std::pow(eigen.eigenvectors()(i, j), 2) > kTakesPart) result.identified[i] = false;
  const Eigen::MatrixXd seen = unit.asDiagonal() * eigen.eigenvectors().rightCols(n - first);
  result.covariance = Eigen::MatrixXd::Zero(n, n);
  if (first == n || result.blocks < 2) {
    result.identified.assign(n, false);
    return result;
  }
  Eigen::MatrixXd steps(n, result.blocks);
  for (int b = 0; b < result.blocks; ++b) {
    const Eigen::MatrixXd A = seen.transpose() * (whole.A + changes[b].A) * seen;
    const Eigen::VectorXd s = seen.transpose() * (whole.b + changes[b].b);
    steps.col(b) = seen * A.completeOrthogonalDecomposition().solve(s);
  }
  const Eigen::MatrixXd centred = steps.colwise() - steps.rowwise().mean();
  result.covariance = (result.blocks - 1.0) / result.blocks * centred * centred.transpose();
  return result;
}

}  // namespace ground
