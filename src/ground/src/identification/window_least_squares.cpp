#include "window_least_squares.h"

#include <Eigen/Cholesky>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>

#include "projected_step.h"

namespace ground::detail {
namespace {

using Vector = Eigen::VectorXd;
using Matrix = Eigen::MatrixXd;

/// The cost as a function of n free parameters theta (in coordinates over scale) and the initial states x_w
/// of the windows w. With the blocks of a window's normal equations,
///
///     [ A  B' ] [ theta's step ]     [ a ]
///     [ B  C  ] [ x_w's step   ] = - [ b ],
///
/// each x_w is eliminated: its step is -C^-1 (b + B theta's step), and A - B' C^-1 B remains (Schur). What is
/// known of theta beforehand adds its diagonal precision to A.
///
/// Levenberg-Marquardt method; the damping follows from the ratio of the decrease to the predicted one
/// (Nielsen 1999).
class WindowLeastSquares {
 public:
  WindowLeastSquares(const Linearisation& windows, const Free& free, double delta, const Solution& from)
      : windows_(windows),
        free_(free),
        weigh_(RobustLoss{delta}.weighing()),
        n_(static_cast<Eigen::Index>(free.index.size())),
        scale_(Eigen::Map<const Vector>(free.scale.data(), n_)),
        lower_(Eigen::Map<const Vector>(free.lower.data(), n_).cwiseQuotient(scale_)),
        upper_(Eigen::Map<const Vector>(free.upper.data(), n_).cwiseQuotient(scale_)),
        precision_(free.weight * free.precision),
        theta_(Eigen::Map<const Vector>(from.scaled.data(), n_)),
        initial_(from.initial),
        trial_initial_(from.initial),
        equations_(initial_.size()),
        trial_equations_(initial_.size()),
        elimination_(initial_.size()) {}

  /// Steps until one lowers the cost by less than `tolerance` (relative) or `absolute`, or for
  /// max_iterations.
  void minimise(double tolerance, double absolute, int max_iterations) {
    constexpr double kNegligible = 0.01;  // share of the smallest decrease below which a step is not tried
    constexpr double kLeastDamping = 1e-12;
    double damping = 1e-4, growth = 2;
    cost_ = linearise(theta_, initial_, equations_);
    while (!converged_ && std::isfinite(cost_) && iterations_ < max_iterations) {
      const double least = tolerance * cost_ + absolute, predicted = step(damping);
      converged_ = std::abs(predicted) < kNegligible * least;
      if (converged_ || !std::isfinite(predicted)) return;
      ++iterations_;
      // Most trials are accepted, so that their derivatives are needed next, but few after a failed one.
      const bool doubtful = growth > 2;
      const double cost = doubtful ? costAt(trial_theta_, trial_initial_)
                                   : linearise(trial_theta_, trial_initial_, trial_equations_);
      const double decrease = cost_ - cost;
      if (predicted > 0 && decrease >= 0) {
        theta_ = trial_theta_;
        initial_ = trial_initial_;
        equations_.swap(trial_equations_);
        cost_ = doubtful ? linearise(theta_, initial_, equations_) : cost;
        converged_ = decrease < least && predicted < 2 * least;
        damping *= std::max(0.1, 1 - std::pow(2 * decrease / predicted - 1, 3));
        damping = std::max(kLeastDamping, damping);
        growth = 2;
      } else {
        converged_ = std::isfinite(cost) && std::abs(predicted) < least;
        damping *= growth;
        growth *= 2;
      }
    }
  }

  Solution solution(double delta) const {
    return {{theta_.begin(), theta_.end()}, initial_, delta, cost_, iterations_, converged_};
  }

 private:
  /// Sets the trial point by a damped step; returns the predicted decrease.
  double step(double damping) {
    Matrix reduced = Matrix::Zero(n_, n_);
    Vector gradient = Vector::Zero(n_), diagonal = Vector::Zero(n_);
    for (std::size_t w = 0; w < equations_.size(); ++w) {
      const auto& [A, b, loss] = equations_[w];
      const Eigen::Index k = b.size() - n_;
      Matrix right(k, n_ + 1);
      right << A.bottomLeftCorner(k, n_), b.tail(k);
      Matrix C = A.bottomRightCorner(k, k);
      C.diagonal() *= 1 + damping;
      elimination_[w] = C.ldlt().solve(right);
      const Matrix eliminated = A.topRightCorner(n_, k) * elimination_[w];
      reduced += A.topLeftCorner(n_, n_) - eliminated.leftCols(n_);
      gradient += b.head(n_) - eliminated.col(n_);
      diagonal += A.diagonal().head(n_);
    }
    const Vector pull = precision_.cwiseProduct(theta_ - free_.known);
    reduced.diagonal() += precision_ + damping * (diagonal + precision_);
    gradient += pull;
    Vector step(n_);
    if (n_ > 0) step = projectedStep(reduced, gradient, lower_ - theta_, upper_ - theta_);
    trial_theta_ = theta_ + step;
    double decrease = -step.dot(pull + 0.5 * precision_.cwiseProduct(step));
    for (std::size_t w = 0; w < equations_.size(); ++w) {
      const auto& [A, b, loss] = equations_[w];
      const Matrix& eliminated = elimination_[w];
      Vector both(b.size());
      both << step, -eliminated.leftCols(n_) * step - eliminated.col(n_);
      trial_initial_[w] = initial_[w] + both.tail(b.size() - n_);
      decrease -= both.dot(b) + 0.5 * both.dot(A * both);
    }
    return decrease;
  }

  /// The cost and its normal equations at a point.
  double linearise(const Vector& theta, const Initials& initial, std::vector<NormalEquations>& equations) {
    windows_.normalEquations(
        at(theta, initial), weigh_, [](int) { return 1; },
        [&](int window, int, const NormalEquations& found) {
          NormalEquations& kept = equations[static_cast<std::size_t>(window)];
          kept = found;
          kept.A.topRows(n_) = scale_.asDiagonal() * kept.A.topRows(n_);
          kept.A.leftCols(n_) = kept.A.leftCols(n_) * scale_.asDiagonal();
          kept.b.head(n_) = scale_.cwiseProduct(kept.b.head(n_));
        });
    double cost = surprise(theta);
    for (const NormalEquations& window : equations) cost += 0.5 * window.loss;
    return cost;
  }

  double costAt(const Vector& theta, const Initials& initial) const {
    double cost = surprise(theta);
    for (const double loss : windows_.losses(at(theta, initial), weigh_)) cost += 0.5 * loss;
    return cost;
  }

  /// The cost of parameters that are not those known beforehand.
  double surprise(const Vector& theta) const {
    return 0.5 * (theta - free_.known).cwiseAbs2().dot(precision_);
  }

  ParameterPoint at(const Vector& theta, const Initials& initial) const {
    return {free_.coordinates(theta.data()), free_.index, initial};
  }

  const Linearisation& windows_;
  const Free& free_;
  const Weigh weigh_;
  const Eigen::Index n_;
  const Vector scale_, lower_, upper_, precision_;
  Vector theta_, trial_theta_;
  Initials initial_, trial_initial_;
  double cost_ = kInfinity;
  int iterations_ = 0;
  bool converged_ = false;
  std::vector<NormalEquations> equations_, trial_equations_;
  std::vector<Matrix> elimination_;  ///< C^-1 [B b] of each window
};

}  // namespace

std::vector<double> lossesOf(FitOptions::Objective objective) {
  if (objective == FitOptions::Objective::kLeastSquares) return {kInfinity};
  return {kInfinity, 1.0, 0.3, 0.1, 0.03, 0.01};
}

Solution minimiseLoss(const Linearisation& windows, const Free& free, double delta, double tolerance,
                      int max_iterations, const Solution& from) {
  constexpr double kExact = 1e-14;  // cost of a window that is fitted exactly
  WindowLeastSquares problem(windows, free, delta, from);
  problem.minimise(tolerance, kExact * static_cast<double>(from.initial.size()), max_iterations);
  Solution found = problem.solution(delta);
  found.iterations += from.iterations;
  return found;
}

Solution restoreUnidentifiable(const Linearisation& windows, const Free& free,
                               const Eigen::MatrixXd& null_space, double tolerance, int max_iterations,
                               const Solution& found) {
  constexpr double kMaxRise = 0.01;  // largest relative rise of the cost
  const Eigen::ColPivHouseholderQR<Eigen::MatrixXd> pivoted(null_space.transpose());
  const Eigen::Index count = pivoted.rank();
  Vector away(count);
  Matrix along(count, null_space.cols());
  std::vector<std::size_t> fixed;
  const auto start = [&](std::size_t i) { return free.base[free.index[i]] / free.scale[i]; };
  for (Eigen::Index j = 0; j < count; ++j) {
    const Eigen::Index i = pivoted.colsPermutation().indices()(j);
    fixed.push_back(static_cast<std::size_t>(i));
    away(j) = start(fixed.back()) - found.scaled[fixed.back()];
    along.row(j) = null_space.row(i);
  }
  if (away.isZero(0)) return found;
  const Vector moved = null_space * along.completeOrthogonalDecomposition().solve(away);
  Solution from = found;
  for (std::size_t i = 0; i < from.scaled.size(); ++i)
    from.scaled[i] = std::clamp(found.scaled[i] + moved(static_cast<Eigen::Index>(i)),
                                free.lower[i] / free.scale[i], free.upper[i] / free.scale[i]);
  Free others = free;
  for (const std::size_t i : fixed) {
    from.scaled[i] = start(i);
    others.lower[i] = others.upper[i] = start(i) * free.scale[i];
  }
  const Solution kept = minimiseLoss(windows, others, found.delta, tolerance, max_iterations, from);
  const double rounding = 1e-12 * static_cast<double>(found.initial.size());
  return kept.cost <= (1 + kMaxRise) * found.cost + rounding ? kept : found;
}

}  // namespace ground::detail
