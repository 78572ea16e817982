// Pseudo-Huber loss of residuals.
#pragma once

#include <cmath>
#include <functional>
#include <limits>

namespace ground::detail {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// Evaluates a loss for `count` residuals: weight W and product s for J'WJ and J's, and the loss
/// itself, which is twice its contribution to the cost. If `weight` is null, sets only the loss.
using Weigh =
    std::function<void(const double* residuals, int count, double* weight, double* product, double* loss)>;

/// Pseudo-Huber loss rho(r) = 2 delta^2 (sqrt(1 + (r/delta)^2) - 1): about r^2 for residuals below
/// delta, about 2 delta |r| above. Infinite delta: least squares. Least-squares solvers use its
/// signed root f(r) as the residual, rho = f^2.
struct RobustLoss {
  double delta = kInfinity;

  /// See Weigh: f'^2, f f', f^2. The compiler vectorises the loops, which have no branches.
  void weigh(const double* residuals, int count, double* weight, double* product, double* loss) const {
    const double over = 1 / (delta * delta);
    if (!weight) {
      for (int i = 0; i < count; ++i) {
        const double square = residuals[i] * residuals[i];
        loss[i] = 2 * square / (1 + std::sqrt(1 + square * over));
      }
      return;
    }
    if (std::isinf(delta)) {
      for (int i = 0; i < count; ++i) {
        weight[i] = 1;
        product[i] = residuals[i];
        loss[i] = residuals[i] * residuals[i];
      }
      return;
    }
    for (int i = 0; i < count; ++i) {
      const double r = residuals[i], root = std::sqrt(1 + r * r * over), inverse = 1 / root;
      weight[i] = 0.5 * (1 + root) * inverse * inverse;
      product[i] = r * inverse;
      loss[i] = 2 * r * r / (1 + root);
    }
  }
  Weigh weighing() const {
    return [robust = *this](const double* residuals, int count, double* weight, double* product,
                            double* loss) { robust.weigh(residuals, count, weight, product, loss); };
  }
  /// Half the derivative of the loss by the residual.
  double score(double r) const { return std::isinf(delta) ? r : r / std::sqrt(1 + r * r / (delta * delta)); }
  /// Half the second derivative of the loss, averaged over about `width` (at least delta), because
  /// absolute values have all their curvature at zero, where few residuals are.
  double curvature(double r, double width) const {
    const double square = 1 + r * r / (width * width);
    return std::isinf(delta) ? 1 : delta / width / (square * std::sqrt(square));
  }
};

}  // namespace ground::detail
