#include "estimates.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <boost/math/distributions/students_t.hpp>
#include <cmath>

namespace ground::detail {

Eigen::MatrixXd correlationOf(const Uncertainty& u, const Free& free) {
  const Eigen::Index n = u.covariance.rows();
  const Eigen::VectorXd deviation = u.covariance.diagonal().cwiseMax(0).cwiseSqrt();
  Eigen::MatrixXd result = Eigen::MatrixXd::Identity(n, n);
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j)
      if (i != j && deviation(i) * deviation(j) > 0)
        result(i, j) =
            free.sign(i) * free.sign(j) * u.covariance(i, j) / (deviation(i) * deviation(j));
  return result;
}

double conditionOf(const Uncertainty& u) {
  const Eigen::VectorXd eigen =
      Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(u.information).eigenvalues();
  return eigen(0) > 0 ? eigen(eigen.size() - 1) / eigen(0) : kInfinity;
}

std::vector<FittedParameter> intervalsOf(const Uncertainty& u, const Free& free,
                                         const std::vector<double>& scaled, const Model& start,
                                         const Model& fitted) {
  const int n = static_cast<int>(free.index.size());
  const std::vector<double> coordinates = free.coordinates(scaled.data());
  const auto infos = fitted.parameters();
  const std::vector<double> before = start.values(), after = fitted.values();
  const boost::math::students_t t(std::max(1, u.blocks - n));
  const double quantile = boost::math::quantile(t, 0.975);
  std::vector<FittedParameter> result;
  for (int i = 0; i < n; ++i) {
    const ParameterInfo& info = infos[free.index[i]];
    const double at = coordinates[free.index[i]], value = after[free.index[i]];
    const double deviation = std::sqrt(std::max(u.covariance(i, i), 0.0));
    const double spread = u.identified[i] ? deviation * free.scale[i] : kInfinity;
    const double half = quantile * spread;
    double low = info.lower, high = info.upper;
    if (u.identified[i]) {
      low = info.fromCoordinate(std::max(at - half, free.lower[i]));
      high = info.fromCoordinate(std::min(at + half, free.upper[i]));
      if (low > high) std::swap(low, high);
    }
    const double slope = info.coordinate == Coordinate::kReciprocal ? value * value : 1;
    const double margin = 1e-4 * free.scale[i];
    const bool at_bound = at - free.lower[i] < margin || free.upper[i] - at < margin;
    result.push_back({info.name, info.unit, before[free.index[i]], value, low, high, slope * spread,
                      at_bound, bool(u.identified[i])});
  }
  return result;
}

}  // namespace ground::detail
