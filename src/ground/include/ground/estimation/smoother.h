#pragma once

#include <Eigen/Core>
#include <vector>

#include "ground/estimation/motion_filter.h"

namespace ground {

/// Smoothed motion at every stamp, one row each.
struct SmoothedMotion {
  Eigen::MatrixX3d eta;      ///< x, y [m], unwrapped psi [rad], world_ned
  Eigen::MatrixX3d nu;       ///< u, v [m/s], r [rad/s], body
  Eigen::MatrixX3d nu_dot;   ///< time derivatives of nu, body
  std::vector<bool> used;    ///< poses that were accepted
  std::vector<bool> starts;  ///< restarts after a gap or a jump
};

/// Velocities without delay from a whole recording: forward Kalman filter and backward smoother
/// (Rauch, Tung, Striebel 1965) with the model of the Kalman estimator. Ignores poses outside the
/// gate; restarts after params.max_gap without pose and after a jump. Stamps [s] must not descend.
/// Rows of eta are x, y [m], psi [rad], wrapped or not. Throws std::invalid_argument on different
/// sizes, fewer than three poses or values that are not finite.
SmoothedMotion smooth(const std::vector<double>& stamps, const Eigen::MatrixX3d& eta,
                      const EstimatorParams& params);

/// Log-likelihood of measured positions (or headings, unwrapped) of one axis under MotionFilter's model with
/// noise of a standard deviation and a jerk. Stretches begin after max_gap without a measurement and, as in
/// smooth(), where several in a row are outliers. `speed`: standard deviation of the velocity there.
/// Measurements may be outliers, which are as likely anywhere in the range of the positions. Throws
/// std::invalid_argument as smooth() does.
double motionLikelihood(const std::vector<double>& stamps, const Eigen::VectorXd& positions, double noise,
                        double jerk, double max_gap, double speed);

}  // namespace ground
