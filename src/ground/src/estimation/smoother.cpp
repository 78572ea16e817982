#include "ground/estimation/smoother.h"

#include <array>
#include <cmath>
#include <stdexcept>
#include <string>

namespace ground {
namespace {

/// The filter after a pose.
struct Step {
  std::array<AxisFilter, 3> axes;
  MotionFilter::Pose pose;
};

void check(const std::vector<double>& stamps, const Eigen::MatrixX3d& eta, const EstimatorParams& params) {
  if (eta.rows() != static_cast<Eigen::Index>(stamps.size()))
    throw std::invalid_argument("there must be as many stamps as poses");
  if (stamps.size() < 3) throw std::invalid_argument("smoothing needs at least three poses");
  if (!eta.allFinite()) throw std::invalid_argument("a pose is not finite");
  for (std::size_t k = 0; k < stamps.size(); ++k)
    if (!std::isfinite(stamps[k]) || (k > 0 && stamps[k] < stamps[k - 1]))
      throw std::invalid_argument("stamps descend or are not finite at pose " + std::to_string(k));
  // Recordings in other units have noise outside the ranges of mocap_state.
  for (const double x : {params.position_noise, params.heading_noise, params.max_gap, params.linear_jerk,
                         params.angular_jerk, params.gate})
    if (!(x > 0) || !std::isfinite(x))
      throw std::invalid_argument("noise levels, jerks, gate and max_gap must be positive");
}

std::vector<Step> filterForward(const std::vector<double>& stamps, const Eigen::MatrixX3d& eta,
                                const EstimatorParams& params) {
  std::vector<Step> steps(stamps.size());
  MotionFilter filter;
  for (std::size_t k = 0; k < stamps.size(); ++k) {
    const MotionFilter::Pose pose = filter.add(stamps[k], eta.row(static_cast<Eigen::Index>(k)), params);
    steps[k] = {filter.axes(), pose};
    if (pose != MotionFilter::Pose::kJumped) continue;
    // Filters again from the first pose after the jump.
    filter.forget();
    k -= MotionFilter::kMinPoses;
  }
  return steps;
}

/// Log-likelihood of a measurement, and correction by it unless it is an outlier. `unreachable`: number of
/// outliers in a row whose innovation exceeds `reach`, the way of a craft since the last other measurement.
double scoreAndCorrect(AxisFilter& filter, double measured, double r, double outlier, double reach,
                       int& unreachable) {
  constexpr double kCap = 25;  // squared distance beyond which a measurement does not correct
  const double innovation = measured - filter.x(0), s = filter.P(0, 0) + r;
  const double distance = innovation * innovation / s;
  if (distance < kCap) filter.correct(0, innovation, r);
  unreachable = distance < kCap || std::abs(innovation) < reach ? 0 : unreachable + 1;
  const double good = -0.5 * (distance + std::log(2 * M_PI * s));
  return std::max(good, outlier) + std::log1p(std::exp(-std::abs(good - outlier)));
}

}  // namespace

double motionLikelihood(const std::vector<double>& stamps, const Eigen::VectorXd& positions, double noise,
                        double jerk, double max_gap, double speed) {
  Eigen::MatrixX3d eta = Eigen::MatrixX3d::Zero(positions.size(), 3);
  eta.col(0) = positions;
  EstimatorParams params;
  params.position_noise = noise;
  params.linear_jerk = jerk;
  params.max_gap = max_gap;
  check(stamps, eta, params);
  if (!(speed > 0)) throw std::invalid_argument("the speed must be positive");
  constexpr double kOutliers = 0.01;  // share
  constexpr int kFree = 3;            // measurements that determine the motion at the start
  constexpr double kNoises = 10;      // noise of both ends of a way, as that of the gate
  const double range = std::max(positions.maxCoeff() - positions.minCoeff(), noise);
  const double outlier = std::log(kOutliers / range);
  AxisFilter filter;
  double sum = 0;
  int since = 0, unreachable = 0;
  double reached = stamps[0];  // when a measurement was last within reach
  for (std::size_t k = 0; k < stamps.size(); ++k, ++since) {
    const double z = positions(static_cast<Eigen::Index>(k));
    if (k == 0 || stamps[k] - stamps[k - 1] > max_gap || unreachable >= MotionFilter::kMinPoses) {
      filter.start(z, noise * noise, speed);
      since = unreachable = 0;
      reached = stamps[k];
      continue;
    }
    filter.predict(stamps[k] - stamps[k - 1], jerk * jerk);
    const double reach = 2 * speed * (stamps[k] - reached) + kNoises * noise;
    const double one = scoreAndCorrect(filter, z, noise * noise, outlier, reach, unreachable);
    if (unreachable == 0) reached = stamps[k];
    if (since >= kFree) sum += one;
  }
  return sum;
}

SmoothedMotion smooth(const std::vector<double>& stamps, const Eigen::MatrixX3d& eta,
                      const EstimatorParams& params) {
  check(stamps, eta, params);
  const std::vector<Step> steps = filterForward(stamps, eta, params);
  const Eigen::Index count = eta.rows();
  SmoothedMotion motion;
  motion.eta.resize(count, 3);
  motion.nu.resize(count, 3);
  motion.nu_dot.resize(count, 3);
  motion.used.resize(count);
  motion.starts.resize(count);
  std::array<Eigen::Vector3d, 3> x;  // position, velocity, acceleration of each axis
  for (Eigen::Index k = count - 1; k >= 0; --k) {
    const bool ends = k == count - 1 || motion.starts[k + 1];
    const double dt = ends ? 0 : stamps[k + 1] - stamps[k];
    for (int i = 0; i < 3; ++i) {
      const AxisFilter& here = steps[k].axes[i];
      if (ends) x[i] = here.x;
      if (dt > 0) x[i] = here.smoothed(x[i], dt, params.jerk(i) * params.jerk(i));
    }
    const auto row = [&x](int j) { return Vector3<double>(x[0](j), x[1](j), x[2](j)); };
    Vector3<double> nu, nu_dot;
    bodyMotion(row(1), row(2), x[2](0), nu, nu_dot);
    motion.eta.row(k) = row(0);
    motion.nu.row(k) = nu;
    motion.nu_dot.row(k) = nu_dot;
    motion.used[k] = steps[k].pose != MotionFilter::Pose::kRejected;
    motion.starts[k] = steps[k].pose == MotionFilter::Pose::kStarts;
  }
  return motion;
}

}  // namespace ground
