#include "inertial_steps.h"

#include <algorithm>
#include <limits>
#include <vector>

namespace ground::detail {
namespace {

constexpr double kMostSpacing =
    3;  ///< a distance of samples, in usual ones, over which nothing is interpolated

/// The usual time between samples [s].
double usualSpacing(const std::vector<double>& times) {
  std::vector<double> spacing;
  for (std::size_t i = 1; i < times.size(); ++i) spacing.push_back(times[i] - times[i - 1]);
  const auto middle = spacing.begin() + static_cast<std::ptrdiff_t>(spacing.size() / 2);
  std::nth_element(spacing.begin(), middle, spacing.end());
  return *middle;
}

/// The integral of samples with straight lines between them, from the first one on.
class Integral {
 public:
  explicit Integral(const InertialData& data)
      : data_(data), sums_(data.values.rows(), 3), bends_(Eigen::MatrixX3d::Zero(data.values.rows(), 3)) {
    sums_.row(0).setZero();
    for (Eigen::Index i = 1; i < sums_.rows(); ++i) {
      sums_.row(i) = sums_.row(i - 1) + 0.5 * (time(i) - time(i - 1)) * (row(i) + row(i - 1));
      bends_.row(i) = bends_.row(i - 1);
      if (i + 1 < sums_.rows()) bends_.row(i) += (row(i - 1) - 2 * row(i) + row(i + 1)).cwiseAbs();
    }
  }

  /// Index of the last sample that is not after a time within the samples.
  Eigen::Index before(double at) const {
    const auto after = std::upper_bound(data_.times.begin(), data_.times.end(), at);
    return std::min<Eigen::Index>(after - data_.times.begin(), sums_.rows() - 1) - 1;
  }
  Eigen::RowVector3d until(double at) const {
    const Eigen::Index i = before(at);
    const double since = at - time(i), share = since / std::max(time(i + 1) - time(i), 1e-9);
    return sums_.row(i) + since * (row(i) + 0.5 * share * (row(i + 1) - row(i)));
  }
  /// Sum of the absolute second differences of the samples about a span.
  Eigen::RowVector3d bends(double from, double to) const {
    return bends_.row(before(to) + 1) - bends_.row(std::max<Eigen::Index>(before(from) - 1, 0));
  }
  double longestStep(double from, double to) const {
    double longest = 0;
    for (Eigen::Index i = before(from); i <= before(to); ++i)
      longest = std::max(longest, time(i + 1) - time(i));
    return longest;
  }

 private:
  double time(Eigen::Index i) const { return data_.times[static_cast<std::size_t>(i)]; }
  Eigen::RowVector3d row(Eigen::Index i) const { return data_.values.row(i); }

  const InertialData& data_;
  Eigen::MatrixX3d sums_, bends_;
};

}  // namespace

SensorVector sensorDeviations() {
  constexpr double kDelay = 2e-3, kTurnBias = 0.02, kTurnScale = 0.03, kBias = 0.1, kScale = 0.1;
  constexpr double kMounting = 0.1, kPlace = 0.03;
  SensorVector deviations;
  deviations << kDelay, kTurnBias, kTurnScale, kBias, kBias, kScale, kMounting, kPlace, kPlace;
  return deviations;
}

InertialSteps::InertialSteps(const RunData& run) {
  const InertialData& data = run.inertial;
  if (data.times.size() < 2) return;
  mean.setConstant(static_cast<Eigen::Index>(run.times.size()), 3, std::numeric_limits<double>::quiet_NaN());
  noise = mean;
  const Integral integral(data);
  const double spacing = usualSpacing(data.times);
  for (Eigen::Index k = 1; k < mean.rows(); ++k) {
    const double from = run.times[static_cast<std::size_t>(k) - 1],
                 to = run.times[static_cast<std::size_t>(k)];
    if (!(to > from && spacing > 0) || from < data.times.front() || to > data.times.back() ||
        integral.longestStep(from, to) > kMostSpacing * spacing)
      continue;
    mean.row(k) = (integral.until(to) - integral.until(from)) / (to - from);
    // As much information a second as the samples have, also where several steps share one of them.
    const double shared = spacing / (to - from);
    // When between two samples a thrust changes is not known: a jump has this error on average.
    const Eigen::RowVector3d unknown = shared / (2 * std::sqrt(12.0)) * integral.bends(from, to);
    noise.row(k) = (shared * data.noise.transpose().cwiseAbs2() + unknown.cwiseAbs2()).cwiseSqrt();
  }
}

SensorRows byErrors(const Vector3<double>& expected, const Vector3<double>& rate) {
  const double r = expected(0), ahead = expected(1), starboard = expected(2), turn = rate(0);
  SensorRows rows = SensorRows::Zero();
  rows.col(0) = rate;
  rows.row(0).segment<2>(1) << 1, r;
  rows.row(1).tail<6>() << 1, 0, ahead, -starboard, -r * r, -turn;
  rows.row(2).tail<6>() << 0, 1, starboard, ahead, turn, -r * r;
  return rows;
}

}  // namespace ground::detail
