#pragma once

#include <cmath>

#include "ground/model/body.h"

namespace ground {

/// Typical magnitudes of a craft, from its parameters. Scales of effect parameters are fractions of
/// them.
namespace typical {

inline double force(const Body<double>& b) { return 2 * b.k * b.input_max; }  ///< full thrust [N]
inline double moment(const Body<double>& b) { return force(b) * b.l; }        ///< [N m]
/// Speed after half a metre at full thrust [m/s].
inline double speed(const Body<double>& b) { return std::sqrt(force(b) / b.m); }
/// Yaw rate after half a radian at full moment [rad/s].
inline double yawRate(const Body<double>& b) { return std::sqrt(moment(b) / b.I_z); }

/// A scale that is the same for all crafts.
inline auto constant(double scale) {
  return [=](const Body<double>&) { return scale; };
}
/// Scale of a coefficient that gives a force [N] from a product of so many speeds and yaw rates.
inline auto forcePer(int speeds, int turns = 0) {
  return [=](const Body<double>& b) {
    return 0.1 * force(b) / (std::pow(speed(b), speeds) * std::pow(yawRate(b), turns));
  };
}
/// As forcePer(), of a moment [N m].
inline auto momentPer(int speeds, int turns = 0) {
  return [per = forcePer(speeds, turns)](const Body<double>& b) { return per(b) * b.l; };
}

}  // namespace typical
}  // namespace ground
