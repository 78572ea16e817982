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

}  // namespace typical
}  // namespace ground
