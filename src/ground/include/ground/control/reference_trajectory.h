#pragma once

#include <memory>
#include <string>
#include <vector>

#include "ground/model/tunable.h"
#include "ground/model/types.h"

namespace ground {

/// Reference position and its derivatives by time, world_ned: [m], [m/s], [m/s^2], [m/s^3].
struct ReferencePoint {
  Vector2<double> p = {0, 0}, p_dot = {0, 0}, p_ddot = {0, 0}, p_dddot = {0, 0};
};

/// A path over time.
class ReferenceTrajectory {
 public:
  virtual ~ReferenceTrajectory() = default;
  /// The point at time t >= 0 [s].
  virtual ReferencePoint at(double t) const = 0;
  /// Time after which the path repeats or ends [s]; for drawing.
  virtual double extent() const = 0;
  /// Times of the points of a file [s], from 0 to the extent; empty for other paths.
  virtual std::vector<double> points() const { return {}; }
};

/// Times at which to check a path [s], ascending from 0: of a file until its end, of other paths for
/// `extents` times their extent. They include those of all points of a file. Up to 20,000 s they are
/// at most 0.05 s apart. They are at least 5000, and at most 400,000 besides the points.
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

/// A reference by its kind, and the parameters of all kinds (see referenceTable).
struct ReferenceParams {
  std::string kind = "circle";
  Vector2<double> origin = Vector2<double>::Zero();  ///< centre or start, world_ned [m]
  double size = 2.0;                                 ///< radius or amplitude [m]
  double rate_of_turn = 0.6;                         ///< [rad/s]
  double petals = 1.5;                               ///< rhodonea: rate of the radius per turn
  double speed = 0.5;                                ///< line, sinusoid, waypoints [m/s]
  Vector2<double> end{2.5, 2.5};                     ///< line: world_ned [m]
  bool smooth = true;                                ///< line, waypoints of a file: start and stop smoothly
  std::string file;                                  ///< CSV, see readReference

  /// All parameters except kind; origin is x, y and end is end_x, end_y.
  static const Tunables<ReferenceParams>& table();
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
