#include "uncertainty.h"

#include <Eigen/Eigenvalues>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>

#include "window_costs.h"

namespace ground {
namespace {

/// Normal equations of the free parameters and one window's initial state.
struct Normal {
  Eigen::MatrixXd A;
  Eigen::VectorXd b;

  explicit Normal(int n) : A(Eigen::MatrixXd::Zero(n, n)), b(Eigen::VectorXd::Zero(n)) {}
  Normal(NormalEquations equations) : A(std::move(equations.A)), b(std::move(equations.b)) {}
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

std::vector<double> residualSizes(const SimulationError& problem, const Model& model,
                                  const std::vector<double>& coordinates, const Initials& initial,
                                  int threads) {
  std::vector<Eigen::VectorXd> windows(problem.windows().size());
  problem.residuals(model, coordinates, {}, initial, false, threads,
                    [&](const WindowResiduals& found) {
                      if (found.finite) windows[found.window] = found.residuals.cwiseAbs();
                    });
  std::vector<double> sizes;
  for (const Eigen::VectorXd& window : windows)
    sizes.insert(sizes.end(), window.begin(), window.end());
  return sizes;
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
  const std::vector<double> sizes = residualSizes(problem, model, coordinates, initial, threads);
  const double width = std::max(robust.delta, sizes.empty() ? 0 : 0.3 * deviationOf(sizes));
  double total = 0;
  for (const Window& window : problem.windows()) total += durationOf(window);
  // In short data blocks are shorter: a covariance of n parameters needs several times n of them.
  block = std::min(block, total / (4 * n));

  const int k = problem.initialSize();
  std::vector<std::vector<Normal>> blocks(problem.windows().size());
  problem.residuals(
      model, coordinates, free.index, initial, true, threads, [&](const WindowResiduals& found) {
        if (!found.finite) return;
        const Window& span = problem.windows()[found.window];
        const int samples = span.last - span.first + 1;
        const int count =
            std::min(samples, std::max(1, static_cast<int>(std::lround(durationOf(span) / block))));
        Eigen::VectorXd curvature(3 * samples), score(3 * samples);
        for (Eigen::Index i = 0; i < score.size(); ++i) {
          curvature(i) = robust.curvature(found.residuals(i), width);
          score(i) = robust.score(found.residuals(i));
        }
        for (int b = 0; b < count; ++b) {
          Normal part = normalEquations(found.derivatives, n + k, curvature, score,
                                        3 * (samples * b / count), 3 * (samples * (b + 1) / count));
          part.A.topRows(n) = scale.asDiagonal() * part.A.topRows(n);
          part.A.leftCols(n) = part.A.leftCols(n) * scale.asDiagonal();
          part.b.head(n) = scale.cwiseProduct(part.b.head(n));
          blocks[found.window].push_back(std::move(part));
        }
      });
  Normal whole(n);
  std::vector<Normal> changes;  // of the whole when a block is left out
  for (const std::vector<Normal>& parts : blocks) {
    if (parts.empty()) continue;
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
