#include "uncertainty.h"

#include <Eigen/Eigenvalues>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>

namespace ground::detail {
namespace {

double durationOf(const SimulationError& problem, const Window& window) {
  const std::vector<double>& times = problem.runs()[window.run].times;
  return times[window.last] - times[window.first];
}

/// Normal equations after elimination of the last `k` columns, the initial state (Schur
/// complement). Without the loss.
NormalEquations reduced(const NormalEquations& whole, Eigen::Index k) {
  const Eigen::MatrixXd& A = whole.A;
  const Eigen::VectorXd& b = whole.b;
  const Eigen::Index n = b.size() - k;
  Eigen::MatrixXd coupling(k, n + 1);  // to the parameters, and to the residuals
  coupling << A.bottomLeftCorner(k, n), b.tail(k);
  const Eigen::MatrixXd follows =
      A.topRightCorner(n, k) * A.bottomRightCorner(k, k).completeOrthogonalDecomposition().solve(coupling);
  NormalEquations result = NormalEquations::zero(n);
  result.A = A.topLeftCorner(n, n) - follows.leftCols(n);
  result.b = b.head(n) - follows.col(n);
  return result;
}

/// Normal equations of the scaled free parameters and a window's initial state, for blocks of about
/// `block` seconds of each window.
std::vector<std::vector<NormalEquations>> equationsOfBlocks(const Linearisation& windows, const Free& free,
                                                            const ParameterPoint& point,
                                                            const RobustLoss& robust, double block) {
  const SimulationError& problem = windows.problem();
  const int n = static_cast<int>(free.index.size()), k = problem.initialSize();
  Eigen::VectorXd scale = Eigen::Map<const Eigen::VectorXd>(free.scale.data(), n);
  for (int i = 0; i < n; ++i)
    if (free.kept(i)) scale(i) = 0;  // no information about it is used
  const double width = std::max(robust.delta, 0.3 * deviationOf(windows.residuals(point)));
  const auto parts = [&](int window) {
    const Window& span = problem.windows()[window];
    const auto count = static_cast<int>(std::lround(durationOf(problem, span) / block));
    return std::min(span.last - span.first + 1, std::max(1, count));
  };
  std::vector<std::vector<NormalEquations>> blocks(problem.windows().size());
  for (std::size_t w = 0; w < blocks.size(); ++w)
    blocks[w].assign(parts(static_cast<int>(w)), NormalEquations::zero(n + k));
  const auto weigh = [robust, width](const double* residuals, int count, double* weight, double* product,
                                     double* loss) {
    const RobustLoss by = robust;  // a local copy, so that the loop is vectorised
    const double over = width;
    for (int i = 0; i < count; ++i) {
      weight[i] = by.curvature(residuals[i], over);
      product[i] = by.score(residuals[i]);
      loss[i] = 0;
    }
  };
  windows.normalEquations(point, weigh, parts, [&](int window, int number, const NormalEquations& equations) {
    NormalEquations& part = blocks[window][number];
    part.A = equations.A;
    part.A.topRows(n) = scale.asDiagonal() * part.A.topRows(n);
    part.A.leftCols(n) = part.A.leftCols(n) * scale.asDiagonal();
    part.b = equations.b;
    part.b.head(n) = scale.cwiseProduct(part.b.head(n));
    if (!std::isfinite(part.A.sum() + part.b.sum())) part = NormalEquations::zero(n + k);
  });
  return blocks;
}

}  // namespace

double deviationOf(std::vector<double> residuals) {
  if (residuals.empty()) return 0;
  for (double& r : residuals) r = std::abs(r);
  const auto middle = residuals.begin() + static_cast<std::ptrdiff_t>(residuals.size() / 2);
  std::nth_element(residuals.begin(), middle, residuals.end());
  return 1.4826 * *middle;
}

namespace {

/// The equations of all windows, and their change if one block is left out.
struct Jackknife {
  NormalEquations whole;
  std::vector<NormalEquations> changes;
};

Jackknife withoutEach(const std::vector<std::vector<NormalEquations>>& blocks, int n, int k) {
  Jackknife result{NormalEquations::zero(n), {}};
  for (const std::vector<NormalEquations>& parts : blocks) {
    NormalEquations window = NormalEquations::zero(n + k);
    for (const NormalEquations& part : parts) window += part;
    const NormalEquations complete = reduced(window, k);
    result.whole += complete;
    for (const NormalEquations& part : parts) {
      NormalEquations rest = window;
      rest -= part;
      result.changes.push_back(parts.size() > 1 ? reduced(rest, k) : NormalEquations::zero(n));
      result.changes.back() -= complete;
    }
  }
  return result;
}

}  // namespace

Uncertainty uncertainty(const Linearisation& windows, const Free& free, const Solution& at) {
  constexpr double kBlock = 1.0 / 3;  // of a window; residuals are nearly independent after that
  const SimulationError& problem = windows.problem();
  const int n = static_cast<int>(free.index.size()), k = problem.initialSize();
  double total = 0;
  for (const Window& window : problem.windows()) total += durationOf(problem, window);
  // A covariance of n parameters needs several times n blocks, so short data have shorter blocks.
  const double block = std::min(kBlock * problem.runs().front().scales.window, total / (4 * n));
  const std::vector<std::vector<NormalEquations>> blocks = equationsOfBlocks(
      windows, free, {free.coordinates(at.scaled.data()), free.index, at.initial}, {at.delta}, block);
  auto [whole, changes] = withoutEach(blocks, n, k);
  const Eigen::VectorXd precision = free.weight * free.precision;
  const Eigen::Map<const Eigen::VectorXd> scaled(at.scaled.data(), n);
  whole.A.diagonal() += precision;
  whole.b += precision.cwiseProduct(scaled - free.known);

  Uncertainty result;
  result.information = whole.A;
  result.known = identifiableBy(whole.A);
  result.blocks = static_cast<int>(changes.size());
  result.covariance = result.shifts = Eigen::MatrixXd::Zero(n, n);
  const Eigen::MatrixXd& along = result.known.directions;
  if (along.cols() == 0 || result.blocks < 2) {
    result.known.parameter.assign(n, false);
    return result;
  }
  Eigen::MatrixXd steps(n, result.blocks);
  for (int b = 0; b < result.blocks; ++b) {
    const Eigen::MatrixXd A = along.transpose() * (whole.A + changes[b].A) * along;
    const Eigen::VectorXd s = along.transpose() * (whole.b + changes[b].b);
    steps.col(b) = along * A.completeOrthogonalDecomposition().solve(s);
  }
  const Eigen::MatrixXd centred = steps.colwise() - steps.rowwise().mean();
  result.covariance = (result.blocks - 1.0) / result.blocks * centred * centred.transpose();
  const Eigen::MatrixXd within = along.transpose() * whole.A * along;
  const Eigen::MatrixXd inverse = along * within.completeOrthogonalDecomposition().solve(along.transpose());
  result.shifts = free.weight * inverse * free.precision.cwiseSqrt().asDiagonal();
  result.covariance += result.shifts * result.shifts.transpose();
  return result;
}

double magnitudeOf(const Linearisation& windows, Free free, const Solution& at) {
  free.weight = 0;
  const Uncertainty u = uncertainty(windows, free, at);
  const auto rank = static_cast<double>(u.known.directions.cols());
  return rank > 0 ? (u.information * u.covariance).trace() / rank : 0;
}

Eigen::VectorXd Uncertainty::deviation() const {
  Eigen::VectorXd found = covariance.diagonal().cwiseMax(0).cwiseSqrt();
  for (Eigen::Index i = 0; i < found.size(); ++i)
    if (!known.parameter[static_cast<std::size_t>(i)]) found(i) = kInfinity;
  return found;
}

Eigen::MatrixXd correlationOf(const Uncertainty& u, const Free& free) {
  const Eigen::Index n = u.covariance.rows();
  const Eigen::VectorXd deviation = u.covariance.diagonal().cwiseMax(0).cwiseSqrt();
  Eigen::MatrixXd result = Eigen::MatrixXd::Identity(n, n);
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j)
      if (i != j && deviation(i) * deviation(j) > 0)
        result(i, j) = free.sign(i) * free.sign(j) * u.covariance(i, j) / (deviation(i) * deviation(j));
  return result;
}

double conditionOf(const Uncertainty& u) {
  const Eigen::VectorXd values = u.information.selfadjointView<Eigen::Lower>().eigenvalues();
  return values(0) > 0 ? values(values.size() - 1) / values(0) : kInfinity;
}

}  // namespace ground::detail
