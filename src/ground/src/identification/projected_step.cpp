#include "projected_step.h"

#include <Eigen/Cholesky>
#include <vector>

namespace ground::detail {

namespace {

/// The s that minimises g's + s'As / 2 with the held elements as they are in `at`.
Eigen::VectorXd minimumBeside(const std::vector<bool>& held, Eigen::MatrixXd A, const Eigen::VectorXd& g,
                              const Eigen::VectorXd& at) {
  Eigen::VectorXd right = -g;
  for (Eigen::Index i = 0; i < g.size(); ++i)
    if (held[i]) right -= A.col(i) * at(i);
  for (Eigen::Index i = 0; i < g.size(); ++i) {
    if (!held[i]) continue;
    A.row(i).setZero();
    A.col(i).setZero();
    A(i, i) = 1;
    right(i) = at(i);
  }
  return A.ldlt().solve(right);
}

}  // namespace

Eigen::VectorXd projectedStep(const Eigen::MatrixXd& A, const Eigen::VectorXd& g,
                              const Eigen::VectorXd& lower, const Eigen::VectorXd& upper) {
  const Eigen::Index n = g.size();
  std::vector<bool> held(static_cast<std::size_t>(n), false);
  Eigen::VectorXd step = Eigen::VectorXd::Zero(n);
  bool changed = true;
  for (Eigen::Index round = 0; changed && round <= 4 * n; ++round) {
    const Eigen::VectorXd solved = minimumBeside(held, A, g, step);
    step = solved.cwiseMax(lower).cwiseMin(upper);
    changed = false;
    for (Eigen::Index i = 0; i < n; ++i)
      if (!held[i] && step(i) != solved(i)) held[i] = changed = true;
    if (changed) continue;
    const Eigen::VectorXd slope = A * step + g;
    for (Eigen::Index i = 0; i < n; ++i) {
      const double inwards = step(i) == lower(i) ? -slope(i) : slope(i);
      if (!held[i] || inwards <= 0 || lower(i) == upper(i)) continue;
      held[i] = false;
      changed = true;
    }
  }
  return step;
}

}  // namespace ground::detail
