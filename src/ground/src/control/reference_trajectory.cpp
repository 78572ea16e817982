#include "ground/control/reference_trajectory.h"

#include <Eigen/Core>
#include <Eigen/SparseLU>
#include <algorithm>
#include <cmath>
#include <complex>
#include <stdexcept>
#include <unsupported/Eigen/Splines>
#include <utility>

#include "ground/control/table_file.h"
#include "ground/model/shortened.h"

namespace ground {
namespace {

using Complex = std::complex<double>;
using Position = Vector2<double>;

/// Adds a exp(i w t), a rotating vector in the plane, and its derivatives.
void addPointer(Complex a, double w, double t, ReferencePoint& point) {
  Complex z = a * std::polar(1.0, w * t);
  for (Position* derivative : {&point.p, &point.p_dot, &point.p_ddot, &point.p_dddot}) {
    *derivative += Position(z.real(), z.imag());
    z *= Complex(0, w);
  }
}

ReferencePoint standing(const Position& p) {
  const Position zero = Position::Zero();
  return {p, zero, zero, zero};
}

/// Progress along a path, from 0 to 1, and its time derivatives.
struct Progress {
  double s, s1, s2, s3;
};

/// Progress over time along a path of some length: at constant speed with a sudden start and stop,
/// or smooth.
class Pace {
 public:
  Pace(double length, double speed, bool smooth) : smooth_(smooth) {
    // The smooth profile's peak is 35/16 of its mean speed.
    duration_ = length / speed * (smooth ? 35.0 / 16.0 : 1.0);
  }
  double duration() const { return duration_; }
  Progress at(double t) const {
    if (t >= duration_) return {1, 0, 0, 0};
    const double x = t / duration_, d = 1 / duration_;
    if (!smooth_) return {x, d, 0, 0};
    // 35 x^4 - 84 x^5 + 70 x^6 - 20 x^7: velocity, acceleration and jerk vanish at both ends.
    const double x2 = x * x, x3 = x2 * x;
    return {x2 * x2 * (35 + x * (-84 + x * (70 - 20 * x))), d * 140 * x3 * (1 + x * (-3 + x * (3 - x))),
            d * d * 420 * x2 * (1 + x * (-4 + x * (5 - 2 * x))),
            d * d * d * 840 * x * (1 + x * (-6 + x * (10 - 5 * x)))};
  }

 private:
  double duration_;
  bool smooth_;
};

/// Quintic spline through points at ascending parameters (times or distances) from 0.
class Curve {
 public:
  Curve(const std::vector<double>& places, const std::vector<Position>& points) : length_(places.back()) {
    const Eigen::Index count = static_cast<Eigen::Index>(points.size());
    const Eigen::Index degree = std::min<Eigen::Index>(kDegree, count - 1);
    const Spline::ParameterVectorType u =
        Eigen::Map<const Spline::ParameterVectorType>(places.data(), count) / length_;
    Spline::KnotVectorType knots;
    Eigen::KnotAveraging(u, degree, knots);
    Eigen::MatrixXd control(count, 2);
    std::vector<Eigen::Triplet<double>> entries;
    for (Eigen::Index i = 0; i < count; ++i) {
      const Eigen::Index span = Spline::Span(u(i), degree, knots);
      const auto basis = Spline::BasisFunctions(u(i), degree, knots);
      for (Eigen::Index j = 0; j <= degree; ++j)
        entries.emplace_back(static_cast<int>(i), static_cast<int>(span - degree + j), basis(j));
      control.row(i) = points[static_cast<std::size_t>(i)].transpose();
    }
    Eigen::SparseMatrix<double> collocation(count, count);
    collocation.setFromTriplets(entries.begin(), entries.end());
    Eigen::SparseLU<Eigen::SparseMatrix<double>, Eigen::NaturalOrdering<int>> solver(collocation);
    if (solver.info() == Eigen::Success) control = solver.solve(control).eval();
    if (solver.info() != Eigen::Success || !control.allFinite())
      throw std::invalid_argument("no spline goes through these points");
    spline_ = Spline(knots, control.transpose());
  }
  double length() const { return length_; }
  /// Position and its derivatives by the parameter.
  ReferencePoint at(double place) const {
    const auto d = spline_.derivatives<3>(std::clamp(place / length_, 0.0, 1.0));
    const double by = 1 / length_;
    const auto derivative = [&](Eigen::Index i) {
      return i < d.cols() ? Position(d.col(i)) : Position::Zero().eval();
    };
    return {derivative(0), by * derivative(1), by * by * derivative(2), by * by * by * derivative(3)};
  }

 private:
  using Spline = Eigen::Spline<double, 2, Eigen::Dynamic>;
  static constexpr Eigen::Index kDegree = 5;
  double length_;
  Spline spline_;
};

// Limits of files.
constexpr std::size_t kMaxPoints = 1000000;
constexpr double kMaxCoordinate = 1e4, kMaxTime = 1e7;  // [m], [s]

template <class At>
ReferencePtr path(double extent, At at) {
  return std::make_shared<const ReferenceTrajectory>(extent, std::move(at));
}

void require(bool good, const char* message) {
  if (!good) throw std::invalid_argument(message);
}

bool turns(double rate) { return std::isfinite(rate) && rate != 0; }

/// Throws if row i of a file of points is out of range or does not follow the one before it.
void checkRow(const TableFile& table, std::size_t i, bool timed) {
  const double* const row = table.row(i);
  const double* const coordinates = row + table.width - 2;
  if (std::max(std::abs(coordinates[0]), std::abs(coordinates[1])) > kMaxCoordinate ||
      std::abs(row[0]) > kMaxTime)
    table.fail(i, "x and y must lie within 10 km, and times within 1e7 s");
  if (i == 0) return;
  const double* const before = table.row(i - 1);
  if (timed && row[0] <= before[0]) table.fail(i, "times must ascend");
  if (!timed && std::equal(row, row + table.width, before))
    table.fail(i, "the point is the same as the one before");
}

}  // namespace

std::vector<double> checkTimes(const ReferenceTrajectory& reference, double extents) {
  constexpr double kLongestStep = 0.05, kFewest = 5000, kMost = 400000;
  const double end = extents * reference.extent();
  const double count = std::ceil(std::clamp(end / kLongestStep, kFewest, kMost));
  std::vector<double> times;
  for (double k = 0; k <= count; ++k) times.push_back(end * k / count);
  return times;
}

ReferencePtr makePoint(const Position& point) {
  return path(1, [point](double) { return standing(point); });
}

ReferencePtr makeCircle(const Position& centre, double radius, double rate) {
  require(radius > 0 && turns(rate), "a circle needs a positive radius and a rate other than 0");
  return path(2 * M_PI / std::abs(rate), [=](double t) {
    ReferencePoint point = standing(centre);
    addPointer(radius, rate, t, point);
    return point;
  });
}

ReferencePtr makeLine(const Position& start, const Position& end, double speed, bool smooth) {
  const Position way = end - start;
  require(speed > 0 && way.norm() > 0, "a line needs a positive speed and two different ends");
  const Pace pace(way.norm(), speed, smooth);
  return path(pace.duration(), [=](double t) -> ReferencePoint {
    const Progress on = pace.at(t);
    return {start + on.s * way, on.s1 * way, on.s2 * way, on.s3 * way};
  });
}

ReferencePtr makeRhodonea(const Position& centre, double amplitude, double petals, double rate) {
  require(amplitude > 0 && std::isfinite(petals) && turns(rate),
          "a rhodonea needs a positive size and a rate other than 0");
  return path(4 * M_PI / std::abs(rate), [=](double t) {
    ReferencePoint point = standing(centre);
    addPointer(amplitude / 2, (1 + petals) * rate, t, point);
    addPointer(amplitude / 2, (1 - petals) * rate, t, point);
    return point;
  });
}

ReferencePtr makeSinusoid(const Position& start, double speed, double amplitude, double rate) {
  require(std::isfinite(speed) && std::isfinite(amplitude) && turns(rate),
          "a sinusoid needs a rate other than 0");
  return path(4 * M_PI / std::abs(rate), [=](double t) -> ReferencePoint {
    const double w = rate, s = amplitude * std::sin(w * t), c = amplitude * std::cos(w * t);
    return {start + Position(speed * t, s), {speed, w * c}, {0, -w * w * s}, {0, -w * w * w * c}};
  });
}

ReferencePtr makeSpline(const std::vector<double>& times, const std::vector<Position>& points) {
  require(points.size() >= 2 && points.size() == times.size(), "a spline needs at least two points");
  require(times.front() == 0, "the first point of a spline must be at time 0");
  for (std::size_t i = 1; i < times.size(); ++i)
    require(times[i] > times[i - 1] && std::isfinite(times[i]), "times must ascend");
  return path(times.back(), [curve = Curve(times, points)](double t) {
    const ReferencePoint point = curve.at(t);
    return t < curve.length() ? point : standing(point.p);
  });
}

ReferencePtr makeWaypoints(const std::vector<Position>& points, double speed, bool smooth) {
  require(points.size() >= 2, "a path needs at least two points");
  require(speed > 0, "a path needs a positive speed");
  std::vector<double> distances = {0};
  for (std::size_t i = 1; i < points.size(); ++i) {
    distances.push_back(distances.back() + (points[i] - points[i - 1]).norm());
    require(distances[i] > distances[i - 1], "neighbouring points of a path must be different");
  }
  const double length = distances.back();
  const Pace pace(length, speed, smooth);
  return path(pace.duration(), [=, curve = Curve(distances, points)](double t) -> ReferencePoint {
    const Progress on = pace.at(t);
    const double s1 = length * on.s1, s2 = length * on.s2, s3 = length * on.s3;
    const ReferencePoint by = curve.at(length * on.s);
    return {by.p, s1 * by.p_dot, s2 * by.p_dot + s1 * s1 * by.p_ddot,
            s3 * by.p_dot + 3 * s1 * s2 * by.p_ddot + s1 * s1 * s1 * by.p_dddot};
  });
}

ReferencePtr readReference(const std::string& path, const Position& origin, double speed, bool smooth) {
  if (path.empty()) throw std::runtime_error("parameter file is empty: set it to a CSV file");
  const TableFile table = readTable(path, kMaxPoints);
  const bool timed = table.header == "time,x,y";
  if (!timed && table.header != "x,y")
    throw std::runtime_error(path + ", line 1: the columns must be time,x,y or x,y, not '" +
                             shortened(table.header) + "'");
  if (table.size() < 2) throw std::runtime_error(path + ", line 1: at least two points must follow");
  std::vector<double> times;
  std::vector<Position> points;
  for (std::size_t i = 0; i < table.size(); ++i) {
    checkRow(table, i, timed);
    const double* const row = table.row(i);
    if (timed) times.push_back(row[0] - table.row(0)[0]);
    points.push_back(origin + Position(row[table.width - 2], row[table.width - 1]));
  }
  return timed ? makeSpline(times, points) : makeWaypoints(points, speed, smooth);
}

bool ReferenceParams::operator==(const ReferenceParams& other) const {
  const Tunables<ReferenceFields>& all = table();
  return kind == other.kind && std::all_of(all.begin(), all.end(),
                                           [&](const auto& one) { return one.get(*this) == one.get(other); });
}

const std::vector<ReferenceInfo>& referenceTable() {
  using P = const ReferenceParams&;
  static const std::vector<ReferenceInfo> table = {
      {"circle",
       "Centre x, y; size is the radius",
       {"x", "y", "size", "rate_of_turn"},
       false,
       [](P p) { return makeCircle(Position(p.x, p.y), p.size, p.rate_of_turn); }},
      {"line",
       "From x, y to end_x, end_y at speed, then stop",
       {"x", "y", "end_x", "end_y", "speed", "smooth"},
       true,
       [](P p) { return makeLine(Position(p.x, p.y), Position(p.end_x, p.end_y), p.speed, p.smooth); }},
      {"rhodonea",
       "Rose curve about x, y",
       {"x", "y", "size", "petals", "rate_of_turn"},
       false,
       [](P p) { return makeRhodonea(Position(p.x, p.y), p.size, p.petals, p.rate_of_turn); }},
      {"sinusoid",
       "From x, y along x; size is the amplitude",
       {"x", "y", "speed", "size", "rate_of_turn"},
       false,
       [](P p) { return makeSinusoid(Position(p.x, p.y), p.speed, p.size, p.rate_of_turn); }},
      {"file",
       "CSV with columns time,x,y or x,y",
       {"file", "x", "y", "speed", "smooth"},
       true,
       [](P p) { return readReference(p.file, Position(p.x, p.y), p.speed, p.smooth); }},
  };
  return table;
}

ReferencePtr makeReference(const ReferenceParams& params) {
  const ReferenceInfo* const info = findNamed(referenceTable(), params.kind);
  if (!info)
    throw std::invalid_argument("reference must be one of " + namesOf(referenceTable()) + ", not '" +
                                params.kind + "'");
  const auto& takes = info->takes;
  for (const Tunable<ReferenceFields>& one : ReferenceParams::table()) {
    if (std::find(takes.begin(), takes.end(), one.name) == takes.end()) continue;
    const std::string wrong = one.rangeError(one.get(params));
    if (!wrong.empty()) throw std::invalid_argument(wrong);
  }
  return info->make(params);
}

}  // namespace ground
