// What the solvers of the fit share: the loss on residuals, free parameters, initial states.
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "ground/identification/simulation_error.h"

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
  /// Of all residuals: the squares of the derivatives, the derivatives times the residuals after
  /// the loss, and the sum of the squares of these.
  double weigh(const Eigen::VectorXd& residuals, Eigen::VectorXd& weight,
               Eigen::VectorXd& product) const {
    if (std::isinf(delta)) {
      weight.setOnes();
      product = residuals;
      return residuals.squaredNorm();
    }
    const double over = 1 / (delta * delta);
    double sum = 0;
    for (Eigen::Index i = 0; i < residuals.size(); ++i) {
      // f^2 and the derivative over f, see derivative(); loops without branches are made of vectors
      const double square = residuals(i) * residuals(i), root = std::sqrt(1 + square * over);
      const double f2 = 2 / (1 + root), slope = 1 - (root - 1) / (2 * root);
      weight(i) = f2 * slope * slope;
      product(i) = f2 * slope * residuals(i);
    }
    for (Eigen::Index i = 0; i < residuals.size(); ++i) {
      const double r = residuals(i);
      sum += 2 * r * r / (1 + std::sqrt(1 + r * r * over));
    }
    return sum;
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

/// Scaling between solver variables of order one and coordinates of the model.
struct Free {
  std::vector<double> base;  ///< coordinates of all parameters, the free ones at their start
  std::vector<int> index;
  std::vector<double> scale, lower, upper;  ///< bounds in coordinates
  std::vector<bool> reciprocal;             ///< the value is one over the coordinate

  std::vector<double> coordinates(const double* scaled) const {
    std::vector<double> all = base;
    for (std::size_t i = 0; i < index.size(); ++i) all[index[i]] = scaled[i] * scale[i];
    return all;
  }
  /// Whether the value grows with the coordinate, or falls.
  double sign(int i) const { return reciprocal[i] ? -1 : 1; }
  /// Sign of the way from the bound that a value sits on into the range; 0 inside the range. A step
  /// that is cut off short of the bound by rounding is on it.
  int inward(std::size_t i, double scaled) const {
    constexpr double kOnBound = 1e-7;
    return scaled - lower[i] / scale[i] <= kOnBound   ? 1
           : upper[i] / scale[i] - scaled <= kOnBound ? -1
                                                      : 0;
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
