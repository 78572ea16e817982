#pragma once

#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "ground/model/types.h"
#include "ground/parameters/ReferenceFields.h"

namespace ground {

/// Reference position and its derivatives by time, world_ned: [m], [m/s], [m/s^2], [m/s^3].
struct ReferencePoint {
  Vector2<double> p = {0, 0}, p_dot = {0, 0}, p_ddot = {0, 0}, p_dddot = {0, 0};
};

/// A path over time that a craft shall follow, with its first three derivatives, which controllers use.
///
///     const ReferencePtr circle = makeCircle({0, 0}, 1.0, 0.4);
///     const Vector2<double> where = circle->at(2.5).p;
///
/// A path need not be one that a craft can follow, nor inside a room: see infeasibility() and leavesRoom().
class ReferenceTrajectory {
 public:
  using At = std::function<ReferencePoint(double t)>;

  ReferenceTrajectory(double extent, At at) : extent_(extent), at_(std::move(at)) {}
  /// The point at time t >= 0 [s].
  ReferencePoint at(double t) const { return at_(t); }
  /// Time after which the path repeats or ends [s]; for drawing.
  double extent() const { return extent_; }

 private:
  double extent_;
  At at_;
};

/// Times at which to check a path [s], from 0 to `extents` times its extent. They are at most 0.05 s apart
/// up to 20,000 s.
std::vector<double> checkTimes(const ReferenceTrajectory& reference, double extents);

using ReferencePtr = std::shared_ptr<const ReferenceTrajectory>;

/// Stands still at `point` [m].
ReferencePtr makePoint(const Vector2<double>& point);
/// (x, y) + R (cos wt, sin wt); R [m], w [rad/s].
ReferencePtr makeCircle(const Vector2<double>& centre, double radius, double rate);
/// From start to end at `speed` [m/s], then standing still. If smooth, three times continuously
/// differentiable with peak speed `speed`; otherwise at constant speed with a sudden stop, as in
/// the thesis.
ReferencePtr makeLine(const Vector2<double>& start, const Vector2<double>& end, double speed, bool smooth);
/// Rose curve (x, y) + a cos(petals s) (cos s, sin s), s = w t; a [m], w [rad/s].
ReferencePtr makeRhodonea(const Vector2<double>& centre, double amplitude, double petals, double rate);
/// (x + v t, y + a sin wt); v [m/s], a [m], w [rad/s].
ReferencePtr makeSinusoid(const Vector2<double>& start, double speed, double amplitude, double rate);

/// Through `points` [m] at `times` [s], ascending, the first at 0: quintic spline, three times
/// continuously differentiable in between. Stands still at the last point from then on.
ReferencePtr makeSpline(const std::vector<double>& times, const std::vector<Vector2<double>>& points);
/// Through `points` [m] by a spline over their distance, at `speed` [m/s]. If smooth, starts and
/// ends at rest with peak speed `speed`.
ReferencePtr makeWaypoints(const std::vector<Vector2<double>>& points, double speed, bool smooth);
/// From a CSV file with the header time,x,y (spline over time [s]) or x,y (waypoints), world_ned
/// [m], shifted by `origin`. At most a million points and 100 MB; a million points take about a
/// second. Throws std::runtime_error that names file and line.
ReferencePtr readReference(const std::string& path, const Vector2<double>& origin, double speed, bool smooth);

/// A reference by its kind, and the parameters of all kinds.
struct ReferenceParams : ReferenceFields {
  std::string kind = "circle";  ///< a name in referenceTable()

  bool operator==(const ReferenceParams& other) const;
};

/// Description of a kind of reference, for documentation and the command line.
struct ReferenceInfo {
  std::string name, text;
  std::vector<std::string> takes;  ///< parameters that it uses, names in ReferenceParams::table()
  bool ends;                       ///< whether it comes to a stop
  ReferencePtr (*make)(const ReferenceParams&);
};

/// All kinds: circle, line, rhodonea, sinusoid, file.
const std::vector<ReferenceInfo>& referenceTable();

/// Throws std::invalid_argument if the kind is unknown, a parameter is outside its range or no such
/// path exists; std::runtime_error if the file cannot be read.
ReferencePtr makeReference(const ReferenceParams& params);

}  // namespace ground
