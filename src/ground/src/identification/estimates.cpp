#include "estimates.h"

#include <algorithm>
#include <boost/math/distributions/students_t.hpp>
#include <cmath>

#include "dense_algebra.h"

namespace ground::detail {

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
  const Eigen::VectorXd values = spectrumOf(u.information).values;
  return values(0) > 0 ? values(values.size() - 1) / values(0) : kInfinity;
}

double quantileOf(double freedom) { return boost::math::quantile(boost::math::students_t(freedom), 0.975); }

FittedParameter estimateOf(const ParameterInfo& info, const Free& free, std::size_t i, double scaled,
                           double deviation, double quantile, double before) {
  const double at = scaled * free.scale[i], spread = deviation * free.scale[i];
  const double value = std::clamp(info.fromCoordinate(at), info.lower, info.upper);
  const bool identified = std::isfinite(spread);
  double low = info.lower, high = info.upper;
  if (identified) {
    low = info.fromCoordinate(std::max(at - quantile * spread, free.lower[i]));
    high = info.fromCoordinate(std::min(at + quantile * spread, free.upper[i]));
    if (low > high) std::swap(low, high);
  }
  const double slope = free.reciprocal[i] ? value * value : 1;
  const double margin = 1e-4 * free.scale[i];
  const bool at_bound = at - free.lower[i] < margin || free.upper[i] - at < margin;
  return {info.name, info.unit, before, value, low, high, slope * spread, at_bound, identified};
}

std::vector<FittedParameter> intervalsOf(const Uncertainty& u, const Free& free,
                                         const std::vector<double>& scaled, const Model& start,
                                         const Model& fitted) {
  const int n = static_cast<int>(free.index.size());
  const auto infos = fitted.parameters();
  const std::vector<double> before = start.values();
  const double quantile = quantileOf(std::max(1, u.blocks - n));
  std::vector<FittedParameter> result;
  for (int i = 0; i < n; ++i) {
    const int at = free.index[i];
    const double deviation = u.identified[i] ? std::sqrt(std::max(u.covariance(i, i), 0.0)) : kInfinity;
    result.push_back(
        estimateOf(infos[at], free, static_cast<std::size_t>(i), scaled[i], deviation, quantile, before[at]));
  }
  return result;
}

}  // namespace ground::detail
