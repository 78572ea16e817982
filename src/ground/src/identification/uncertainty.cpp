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

double deviationOf(std::vector<double> residuals) {
  if (residuals.empty()) return 0;
  for (double& r : residuals) r = std::abs(r);
  const auto middle = residuals.begin() + static_cast<std::ptrdiff_t>(residuals.size() / 2);
  std::nth_element(residuals.begin(), middle, residuals.end());
  return 1.4826 * *middle;
}

Uncertainty uncertainty(Linearisation& windows, const Free& free,
                        const std::vector<double>& coordinates, const Initials& initial,
                        const Robust& robust, double block) {
  const SimulationError& problem = windows.problem();
  const int n = static_cast<int>(free.index.size());
  const Eigen::VectorXd scale = Eigen::Map<const Eigen::VectorXd>(free.scale.data(), n);
  const auto durationOf = [&problem](const Window& w) {
    const std::vector<double>& times = problem.runs()[w.run].times;
    return times[w.last] - times[w.first];
  };
  const Linearisation::Point point{coordinates, free.index, initial};
  const double width = std::max(robust.delta, 0.3 * deviationOf(windows.residuals(point)));
  double total = 0;
  for (const Window& window : problem.windows()) total += durationOf(window);
  // In short data blocks are shorter: a covariance of n parameters needs several times n of them.
  block = std::min(block, total / (4 * n));

  const int k = problem.initialSize();
  const auto parts = [&](int window) {
    const Window& span = problem.windows()[window];
    const auto count = static_cast<int>(std::lround(durationOf(span) / block));
    return std::min(span.last - span.first + 1, std::max(1, count));
  };
  std::vector<std::vector<Normal>> blocks(problem.windows().size());
  for (std::size_t w = 0; w < blocks.size(); ++w)
    blocks[w].assign(parts(static_cast<int>(w)), Normal(n + k));
  const auto weigh = [robust, width](const double* residuals, int count, double* weight,
                                     double* product, double* loss) {
    const Robust by = robust;  // nothing that is written to
    const double over = width;
    for (int i = 0; i < count; ++i) {
      weight[i] = by.curvature(residuals[i], over);
      product[i] = by.score(residuals[i]);
      loss[i] = 0;
    }
  };
  windows.normalEquations(point, weigh, parts,
                          [&](int window, int number, const NormalEquations& equations) {
                            Normal& part = blocks[window][number];
                            part.A = equations.A;
                            part.A.topRows(n) = scale.asDiagonal() * part.A.topRows(n);
                            part.A.leftCols(n) = part.A.leftCols(n) * scale.asDiagonal();
                            part.b = equations.b;
                            part.b.head(n) = scale.cwiseProduct(part.b.head(n));
                            if (!std::isfinite(part.A.sum() + part.b.sum())) part = Normal(n + k);
                          });
  Normal whole(n);
  std::vector<Normal> changes;  // of the whole when a block is left out
  for (const std::vector<Normal>& parts : blocks) {
    Normal window(n + k);
    for (const Normal& part : parts) window += part;
    const Normal reduced = window.reduced(k);
    whole += reduced;
    for (const Normal& part : parts) {
      Normal rest = window;
      rest -= part;
      changes.push_back(parts.size() > 1 ? rest.reduced(k) : Normal(n));
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
  const Eigen::VectorXd sizes = (unit.array() > 0).select(unit, 1.0);
  result.unseen = sizes.asDiagonal() * eigen.eigenvectors().leftCols(first);
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
