// What the solvers of the fit share: the loss on residuals, free parameters, initial states.
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "ground/identification/simulation_error.h"
#include "free_parameters.h"
#include "normal_equations.h"

namespace ground {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// Pseudo-Huber: square for residuals below delta, absolute value above, as a residual of its own.
struct Robust {
  double delta = kInfinity;

  double operator()(double r) const { return r * factor(r); }
  double derivative(double r) const {
    if (std::isinf(delta)) return 1;
    const double root = std::sqrt(1 + r * r / (delta * delta)), f = factor(r);
    return r == 0 ? 1 : f * (1 - (root - 1) / (2 * root));
  }
  /// As Weigh: the square of the derivative, half the derivative of the square, the square. Loops
  /// without branches are made of vectors.
  void weigh(const double* residuals, int count, double* weight, double* product,
             double* loss) const {
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
    return
        [robust = *this](const double* residuals, int count, double* weight, double* product,
                         double* loss) { robust.weigh(residuals, count, weight, product, loss); };
  }
  /// Half the derivative of the loss by the residual.
  double score(double r) const {
    return std::isinf(delta) ? r : r / std::sqrt(1 + r * r / (delta * delta));
  }
  /// Half the second derivative of the loss, averaged over about `width` (no less than delta):
  /// absolute values have all their curvature at zero, where few residuals are.
  double curvature(double r, double width) const {
    const double square = 1 + r * r / (width * width);
    return std::isinf(delta) ? 1 : delta / width / (square * std::sqrt(square));
  }

 private:
  double factor(double r) const {
    return std::isinf(delta) ? 1 : std::sqrt(2 / (1 + std::sqrt(1 + r * r / (delta * delta))));
  }
};

using Initials = std::vector<Eigen::VectorXd>;

/// The initial states that were measured.
Initials measuredInitials(const SimulationError& problem);

/// Losses to descend by, one after the other. Plain squares come first, they have the widest basin;
/// absolute values are approached from them.
inline std::vector<double> lossesOf(FitOptions::Objective objective) {
  if (objective == FitOptions::Objective::kLeastSquares) return {kInfinity};
  return {kInfinity, 1.0, 0.3, 0.1, 0.03, 0.01};
}

/// Throws std::invalid_argument unless there is an initial state for each window.
void checkInitials(const SimulationError& problem, const Initials& initial);

/// "The model's motion is not finite in …".
std::string notFinite(const SimulationError& problem, int window);

/// The initial state of one window that suits the model best, sought from the given one. Ends when
/// a step lowers the cost of a sample by less than `tolerance`.
void solveInitial(const SimulationError& problem, const Model& model,
                  const std::vector<double>& coordinates, const Robust& robust, int window,
                  Eigen::VectorXd& initial, double tolerance = 3e-10);

}  // namespace ground
