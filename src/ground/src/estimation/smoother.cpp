#include "ground/estimation/smoother.h"

#include <Eigen/LU>
#include <array>
#include <stdexcept>

namespace ground {

SmoothedMotion smooth(const std::vector<double>& stamps, const Eigen::MatrixX3d& eta,
                      const EstimatorParams& params) {
  const Eigen::Index count = eta.rows();
  if (count != static_cast<Eigen::Index>(stamps.size()))
    throw std::invalid_argument("there must be as many stamps as poses");
  if (count < 3) throw std::invalid_argument("smoothing needs at least three poses");
  if (!eta.allFinite()) throw std::invalid_argument("a pose is not finite");
  const std::string wrong = params.validate();
  if (!wrong.empty()) throw std::invalid_argument(wrong);

  struct Step {
    AxisFilter predicted, filtered;
    double dt;
  };
  std::array<std::vector<Step>, 3> steps;
  SmoothedMotion motion;
  motion.used.assign(count, true);
  std::array<AxisFilter, 3> axes;
  int rejected = 0;
  const std::array<double, 3> noise = {params.position_noise, params.position_noise,
                                       params.heading_noise};
  const std::array<double, 3> jerk = {params.linear_jerk, params.linear_jerk, params.angular_jerk};
  for (Eigen::Index k = 0; k < count; ++k) {
    const double dt = k == 0 ? 0 : stamps[k] - stamps[k - 1];
    if (!(dt >= 0)) throw std::invalid_argument("stamps descend at pose " + std::to_string(k));
    Eigen::Vector3d z = eta.row(k);
    bool believed = true;
    for (int i = 0; i < 3; ++i) {
      const double r = noise[i] * noise[i], spread = i < 2 ? 3.0 : 20.0;
      if (k == 0) {
        axes[i].reset(z(i), r, spread * spread, 9 * spread * spread);
      } else {
        axes[i].predict(dt, jerk[i] * jerk[i]);
      }
      if (i == 2) z(2) = axes[2].x(0) + wrapAngle(z(2) - axes[2].x(0));
      const double innovation = z(i) - axes[i].x(0), s = axes[i].P(0, 0) + r;
      believed = believed && innovation * innovation <= params.gate * params.gate * s;
    }
    // After several in a row it is the filter that is wrong.
    rejected = believed ? 0 : rejected + 1;
    if (rejected > 5) believed = true;
    motion.used[k] = believed;
    for (int i = 0; i < 3; ++i) {
      Step step{axes[i], axes[i], dt};
      if (believed && k > 0) step.filtered.correct(z(i) - axes[i].x(0), noise[i] * noise[i]);
      axes[i] = step.filtered;
      steps[i].push_back(step);
    }
  }

  std::array<Eigen::MatrixX3d, 3> states;  // a row is position, velocity, acceleration
  for (int i = 0; i < 3; ++i) {
    states[i].resize(count, 3);
    Eigen::Vector3d x = steps[i].back().filtered.x;
    states[i].row(count - 1) = x;
    for (Eigen::Index k = count - 2; k >= 0; --k) {
      const Step &here = steps[i][k], &next = steps[i][k + 1];
      if (next.dt > 0) {
        const Eigen::Matrix3d gain = here.filtered.P * AxisFilter::transition(next.dt).transpose() *
                                     next.predicted.P.inverse();
        x = here.filtered.x + gain * (x - next.predicted.x);
      }
      states[i].row(k) = x;
    }
  }
  motion.eta.resize(count, 3);
  motion.nu.resize(count, 3);
  motion.nu_dot.resize(count, 3);
  for (Eigen::Index k = 0; k < count; ++k) {
    const auto row = [&](int column) {
      return Vector3<double>(states[0](k, column), states[1](k, column), states[2](k, column));
    };
    Vector3<double> nu, nu_dot;
    bodyMotion(row(1), row(2), states[2](k, 0), nu, nu_dot);
    motion.eta.row(k) = row(0);
    motion.nu.row(k) = nu;
    motion.nu_dot.row(k) = nu_dot;
  }
  return motion;
}

}  // namespace ground
