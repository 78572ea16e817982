#include "estimates.h"

#include <Eigen/Eigenvalues>
#include <Eigen/QR>
#include <algorithm>
#include <boost/math/distributions/students_t.hpp>
#include <cmath>
#include <limits>

namespace ground::detail {

Identifiable identifiableBy(const Eigen::MatrixXd& information) {
  constexpr double kMinInformation = 1e-14, kMinEigenvalue = 1e-10;  // relative to the largest
  constexpr double kMaxParticipation = 1e-6;  // squared, of identified parameters in the null space
  const Eigen::Index n = information.rows();
  const Eigen::VectorXd diagonal = information.diagonal();
  const auto informed = diagonal.array() > kMinInformation * diagonal.maxCoeff();
  const Eigen::VectorXd unit = informed.select(diagonal.cwiseMax(0).cwiseSqrt().cwiseInverse(), 0.0);
  const Eigen::VectorXd size = informed.select(unit, 1.0);
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> even(unit.asDiagonal() * information *
                                                            unit.asDiagonal());
  Eigen::Index first = 0;  // first identifiable direction
  while (first < n && !(even.eigenvalues()(first) > kMinEigenvalue * even.eigenvalues()(n - 1))) ++first;
  Identifiable found;
  for (Eigen::Index i = 0; i < n; ++i)
    found.parameter.push_back(even.eigenvectors().row(i).head(first).squaredNorm() < kMaxParticipation);
  const Eigen::VectorXd values = even.eigenvalues().tail(n - first);
  found.directions = size.asDiagonal() * even.eigenvectors().rightCols(n - first) *
                     values.cwiseSqrt().cwiseInverse().asDiagonal();
  const Eigen::MatrixXd flat = size.asDiagonal() * even.eigenvectors().leftCols(first);
  found.null_space = flat.householderQr().householderQ() * Eigen::MatrixXd::Identity(n, first);
  found.log_determinant = values.array().log().sum() - 2 * size.array().log().sum();
  return found;
}

double quantileOf(double freedom) { return boost::math::quantile(boost::math::students_t(freedom), 0.975); }

std::vector<FittedParameter> estimatesOf(const Model& model, const Free& free,
                                         const std::vector<double>& scaled, const Eigen::VectorXd& deviation,
                                         const Eigen::VectorXd& quantile) {
  const auto infos = model.parameters();
  std::vector<FittedParameter> result;
  for (std::size_t i = 0; i < scaled.size(); ++i) {
    const ParameterInfo& info = infos[free.index[i]];
    const double at = scaled[i] * free.scale[i];
    const double spread = deviation(static_cast<Eigen::Index>(i)) * free.scale[i];
    const double value = std::clamp(info.fromCoordinate(at), info.lower, info.upper);
    const bool identified = std::isfinite(spread);
    double low = info.lower > std::numeric_limits<double>::min() ? info.lower : std::min(info.lower, 0.0);
    double high = info.upper;
    if (identified) {
      const double reach = quantile(static_cast<Eigen::Index>(i)) * spread;
      if (free.reciprocal[i]) std::swap(low, high);
      if (at - reach > free.lower[i]) low = info.fromCoordinate(at - reach);
      if (at + reach < free.upper[i]) high = info.fromCoordinate(at + reach);
      if (low > high) std::swap(low, high);
    }
    const double slope = free.reciprocal[i] ? value * value : 1;
    // The start, which sets the scale, may be far off: an estimate is compared with its own deviation.
    const double margin = 1e-4 * std::min(free.scale[i], spread);
    const bool at_bound = !free.kept(i) && (at - free.lower[i] <= margin || free.upper[i] - at <= margin);
    const double before = info.fromCoordinate(free.base[free.index[i]]);
    result.push_back({info.name, info.unit, before, value, low, high, slope * spread, at_bound, identified});
  }
  return result;
}

}  // namespace ground::detail
