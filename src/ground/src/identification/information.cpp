#include "information.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "dense_algebra.h"
#include "estimates.h"

namespace ground::detail {
namespace {

// Largest deviation, relative to a parameter's typical size, of an identified parameter.
constexpr double kMaxDeviation = 30;

}  // namespace

Known knownBy(const Eigen::MatrixXd& information) {
  const Eigen::Index n = information.rows();
  const Eigen::VectorXd size =
      information.diagonal().cwiseMax(std::numeric_limits<double>::min()).cwiseSqrt();
  const Eigen::MatrixXd even =
      size.cwiseInverse().asDiagonal() * information * size.cwiseInverse().asDiagonal();
  const Spectrum eigen = spectrumOf(even);
  constexpr double kMinEigenvalue = 1e-10;     // of identifiable directions, over the largest
  constexpr double kMaxParticipation = 1e-12;  // squared, of identified parameters in the others
  Eigen::Index first = 0;                      // first identifiable direction
  while (first < n && !(eigen.values(first) > kMinEigenvalue * eigen.values(n - 1))) ++first;
  const Eigen::MatrixXd directions = size.cwiseInverse().asDiagonal() * eigen.vectors;
  Known known;
  known.variance = directions.rightCols(n - first).cwiseAbs2() * eigen.values.tail(n - first).cwiseInverse();
  for (Eigen::Index i = 0; i < n; ++i)
    known.identified.push_back(eigen.vectors.row(i).head(first).squaredNorm() < kMaxParticipation &&
                               known.variance(i) < kMaxDeviation * kMaxDeviation);
  known.volume = eigen.values.tail(n - first).array().log().sum() + 2 * size.array().log().sum();
  known.unseen = orthonormalised(directions.leftCols(first));
  return known;
}

std::vector<FittedParameter> estimatesBy(const Known& known, const Model& model, const Free& free,
                                         const std::vector<double>& scaled,
                                         const std::vector<double>& freedom) {
  std::vector<FittedParameter> result;
  const auto infos = model.parameters();
  for (std::size_t i = 0; i < scaled.size(); ++i) {
    constexpr double kNormal = 1.959964;  // 97.5% quantile
    const double deviation =
        known.identified[i] ? std::sqrt(known.variance(static_cast<Eigen::Index>(i))) : kInfinity;
    const ParameterInfo& info = infos[free.index[i]];
    const double quantile = freedom.empty() ? kNormal : quantileOf(freedom[i]);
    const double before = info.fromCoordinate(free.base[free.index[i]]);
    result.push_back(estimateOf(info, free, i, scaled[i], deviation, quantile, before));
  }
  return result;
}

}  // namespace ground::detail
