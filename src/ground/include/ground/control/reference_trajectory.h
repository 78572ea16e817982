#pragma once

#include <memory>
#include <string>

#include "ground/model/types.h"

namespace ground {

/// Reference position and its derivatives by time, world_ned.
struct ReferencePoint {
  Vector2<double> p, p_dot, p_ddot, p_dddot;  ///< [m], [m/s], [m/s^2], [m/s^3]
};

/// A path over time.
class ReferenceTrajectory {
 public:
  virtual ~ReferenceTrajectory() = default;
  /// The point at time t >= 0 [s].
  virtual ReferencePoint at(double t) const = 0;
  /// Time after which the path repeats or stands still [s]; for drawing.
  virtual double extent() const = 0;
};

using ReferencePtr = std::shared_ptr<const ReferenceTrajectory>;

/// (x, y) + R (cos wt, sin wt); R [m], w [rad/s].
ReferencePtr makeCircle(const Vector2<double>& centre, double radius, double rate);
/// From start to end at `speed` [m/s], then standing still. Smooth: three times continuously
/// differentiable, with `speed` as its peak; otherwise at constant speed with a sudden stop, as in
/// the thesis.
ReferencePtr makeLine(const Vector2<double>& start, const Vector2<double>& end, double speed,
                      bool smooth);
/// Rose curve (x, y) + a cos(petals s) (cos s, sin s), s = w t; a [m], w [rad/s].
ReferencePtr makeRhodonea(const Vector2<double>& centre, double amplitude, double petals,
                          double rate);
/// (x + v t, y + a sin wt); v [m/s], a [m], w [rad/s].
ReferencePtr makeSinusoid(const Vector2<double>& start, double speed, double amplitude,
                          double rate);

}  // namespace ground
