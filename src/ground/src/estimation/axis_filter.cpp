#include "ground/estimation/axis_filter.h"

namespace ground {

Eigen::Matrix3d AxisFilter::transition(double dt) {
  Eigen::Matrix3d F;
  F << 1, dt, dt * dt / 2, 0, 1, dt, 0, 0, 1;
  return F;
}

void AxisFilter::reset(double position, double r, double velocity_variance,
                       double acceleration_variance) {
  x << position, 0, 0;
  P = Eigen::Vector3d(r, velocity_variance, acceleration_variance).asDiagonal();
}

void AxisFilter::predict(double dt, double q) {
  const Eigen::Matrix3d F = transition(dt);
  const double d2 = dt * dt, d3 = d2 * dt, d4 = d3 * dt, d5 = d4 * dt;
  Eigen::Matrix3d Q;
  Q << d5 / 20, d4 / 8, d3 / 6, d4 / 8, d3 / 3, d2 / 2, d3 / 6, d2 / 2, dt;
  x = F * x;
  P = F * P * F.transpose() + q * Q;
}

void AxisFilter::correct(double innovation, double r) {
  const Eigen::Vector3d K = P.col(0) / (P(0, 0) + r);
  x += K * innovation;
  P -= K * P.row(0).eval();
  P = 0.5 * (P + P.transpose()).eval();
}

}  // namespace ground
