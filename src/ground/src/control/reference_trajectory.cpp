#include "ground/control/reference_trajectory.h"

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <complex>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <stdexcept>
#include <unsupported/Eigen/Splines>

#include "ground/model/text_file.h"

namespace ground {
namespace {

using Complex = std::complex<double>;

/// Adds a exp(i w t), a rotating vector in the plane, and its derivatives.
void addPointer(Complex a, double w, double t, ReferencePoint& point) {
  Complex z = a * std::polar(1.0, w * t);
  for (Vector2<double>* derivative : {&point.p, &point.p_dot, &point.p_ddot, &point.p_dddot}) {
    *derivative += Vector2<double>(z.real(), z.imag());
    z *= Complex(0, w);
  }
}

ReferencePoint at(const Vector2<double>& p) {
  const Vector2<double> zero = Vector2<double>::Zero();
  return {p, zero, zero, zero};
}

class StandingStill : public ReferenceTrajectory {
 public:
  explicit StandingStill(const Vector2<double>& point) : point_(point) {}
  ReferencePoint at(double) const override { return ground::at(point_); }
  double extent() const override { return 1; }

 private:
  Vector2<double> point_;
};

class Circle : public ReferenceTrajectory {
 public:
  Circle(const Vector2<double>& centre, double radius, double rate)
      : centre_(centre), radius_(radius), rate_(rate) {}
  ReferencePoint at(double t) const override {
    ReferencePoint point = ground::at(centre_);
    addPointer(radius_, rate_, t, point);
    return point;
  }
  double extent() const override { return 2 * M_PI / std::abs(rate_); }

 private:
  Vector2<double> centre_;
  double radius_, rate_;
};

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
  /// When the progress is s [s].
  double timeAt(double s) const {
    if (s >= 1) return duration_;
    if (!smooth_) return s * duration_;
    double early = 0, late = duration_;
    while (late - early > 1e-9 * duration_) {
      const double middle = 0.5 * (early + late);
      (at(middle).s < s ? early : late) = middle;
    }
    return late;
  }
  Progress at(double t) const {
    if (t >= duration_) return {1, 0, 0, 0};
    const double x = t / duration_, d = 1 / duration_;
    if (!smooth_) return {x, d, 0, 0};
    // 35 x^4 - 84 x^5 + 70 x^6 - 20 x^7: velocity, acceleration and jerk vanish at both ends.
    const double x2 = x * x, x3 = x2 * x;
    return {x2 * x2 * (35 + x * (-84 + x * (70 - 20 * x))),
            d * 140 * x3 * (1 + x * (-3 + x * (3 - x))),
            d * d * 420 * x2 * (1 + x * (-4 + x * (5 - 2 * x))),
            d * d * d * 840 * x * (1 + x * (-6 + x * (10 - 5 * x)))};
  }

 private:
  double duration_;
  bool smooth_;
};

class Line : public ReferenceTrajectory {
 public:
  Line(const Vector2<double>& start, const Vector2<double>& end, double speed, bool smooth)
      : start_(start), way_(end - start), pace_(way_.norm(), speed, smooth) {}
  ReferencePoint at(double t) const override {
    const Progress on = pace_.at(t);
    return {start_ + on.s * way_, on.s1 * way_, on.s2 * way_, on.s3 * way_};
  }
  double extent() const override { return pace_.duration(); }

 private:
  Vector2<double> start_, way_;
  Pace pace_;
};

class Rhodonea : public ReferenceTrajectory {
 public:
  Rhodonea(const Vector2<double>& centre, double amplitude, double petals, double rate)
      : centre_(centre), amplitude_(amplitude), petals_(petals), rate_(rate) {}
  ReferencePoint at(double t) const override {
    ReferencePoint point = ground::at(centre_);
    addPointer(amplitude_ / 2, (1 + petals_) * rate_, t, point);
    addPointer(amplitude_ / 2, (1 - petals_) * rate_, t, point);
    return point;
  }
  double extent() const override { return 4 * M_PI / std::abs(rate_); }

 private:
  Vector2<double> centre_;
  double amplitude_, petals_, rate_;
};

class Sinusoid : public ReferenceTrajectory {
 public:
  Sinusoid(const Vector2<double>& start, double speed, double amplitude, double rate)
      : start_(start), speed_(speed), amplitude_(amplitude), rate_(rate) {}
  ReferencePoint at(double t) const override {
    const double s = amplitude_ * std::sin(rate_ * t), c = amplitude_ * std::cos(rate_ * t);
    ReferencePoint point = ground::at(start_ + Vector2<double>(speed_ * t, s));
    point.p_dot = {speed_, rate_ * c};
    point.p_ddot = {0, -rate_ * rate_ * s};
    point.p_dddot = {0, -rate_ * rate_ * rate_ * c};
    return point;
  }
  double extent() const override { return 4 * M_PI / std::abs(rate_); }

 private:
  Vector2<double> start_;
  double speed_, amplitude_, rate_;
};

/// Banded linear equations: row i has entries only in columns i - band to i + band. Time and memory
/// grow linearly with the number of rows. Collocation matrices of B-splines are totally positive,
/// so elimination needs no pivoting (de Boor, A Practical Guide to Splines, XIII).
class BandedSystem {
 public:
  BandedSystem(Eigen::Index count, Eigen::Index band)
      : band_(band), rows_(Rows::Zero(count, 2 * band + 1)) {}
  double& at(Eigen::Index row, Eigen::Index column) { return rows_(row, column - row + band_); }
  /// Replaces the right-hand sides by the solution; false if there is none. Call only once.
  bool solve(Eigen::MatrixXd& sides) {
    const Eigen::Index count = rows_.rows();
    for (Eigen::Index k = 0; k < count; ++k) {
      if (!(at(k, k) > 0)) return false;
      const Eigen::Index last = std::min(k + band_, count - 1);
      for (Eigen::Index i = k + 1; i <= last; ++i) {
        const double factor = at(i, k) / at(k, k);
        if (factor == 0) continue;
        for (Eigen::Index j = k; j <= last; ++j) at(i, j) -= factor * at(k, j);
        sides.row(i) -= factor * sides.row(k);
      }
    }
    for (Eigen::Index k = count - 1; k >= 0; --k) {
      for (Eigen::Index j = k + 1; j <= std::min(k + band_, count - 1); ++j)
        sides.row(k) -= at(k, j) * sides.row(j);
      sides.row(k) /= at(k, k);
    }
    return sides.allFinite();
  }

 private:
  using Rows = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

  Eigen::Index band_;
  Rows rows_;
};

/// Quintic spline through points at ascending parameters (times or distances) from 0.
class Curve {
 public:
  Curve(const std::vector<double>& places, const std::vector<Vector2<double>>& points)
      : length_(places.back()) {
    const Eigen::Index count = static_cast<Eigen::Index>(points.size());
    const Eigen::Index degree = std::min<Eigen::Index>(kDegree, count - 1);
    const Spline::ParameterVectorType u =
        Eigen::Map<const Spline::ParameterVectorType>(places.data(), count) / length_;
    Spline::KnotVectorType knots;
    Eigen::KnotAveraging(u, degree, knots);
    Eigen::MatrixXd control(count, 2);
    BandedSystem collocation(count, degree);
    for (Eigen::Index i = 0; i < count; ++i) {
      const Eigen::Index span = Spline::Span(u(i), degree, knots);
      const auto basis = Spline::BasisFunctions(u(i), degree, knots);
      for (Eigen::Index j = 0; j <= degree; ++j) collocation.at(i, span - degree + j) = basis(j);
      control.row(i) = points[static_cast<std::size_t>(i)].transpose();
    }
    if (!collocation.solve(control))
      throw std::invalid_argument("no spline goes through these points");
    spline_ = Spline(knots, control.transpose());
  }
  double length() const { return length_; }
  /// Position and its derivatives by the parameter.
  ReferencePoint at(double place) const {
    const auto d = spline_.derivatives<3>(std::clamp(place / length_, 0.0, 1.0));
    const double by = 1 / length_;
    const auto derivative = [&](Eigen::Index i) {
      return i < d.cols() ? Vector2<double>(d.col(i)) : Vector2<double>::Zero().eval();
    };
    return {derivative(0), by * derivative(1), by * by * derivative(2),
            by * by * by * derivative(3)};
  }

 private:
  using Spline = Eigen::Spline<double, 2, Eigen::Dynamic>;
  static constexpr Eigen::Index kDegree = 5;
  double length_;
  Spline spline_;
};

class TimedSpline : public ReferenceTrajectory {
 public:
  TimedSpline(const std::vector<double>& times, const std::vector<Vector2<double>>& points)
      : curve_(times, points), times_(times) {}
  ReferencePoint at(double t) const override {
    const ReferencePoint point = curve_.at(t);
    return t < curve_.length() ? point : ground::at(point.p);
  }
  double extent() const override { return curve_.length(); }
  std::vector<double> points() const override { return times_; }

 private:
  Curve curve_;
  std::vector<double> times_;
};

class Waypoints : public ReferenceTrajectory {
 public:
  Waypoints(const std::vector<double>& distances, const std::vector<Vector2<double>>& points,
            double speed, bool smooth)
      : curve_(distances, points),
        distances_(distances),
        pace_(curve_.length(), speed, smooth) {}
  ReferencePoint at(double t) const override {
    const Progress on = pace_.at(t);
    const double length = curve_.length();
    const double s1 = length * on.s1, s2 = length * on.s2, s3 = length * on.s3;
    const ReferencePoint by = curve_.at(length * on.s);
    return {by.p, s1 * by.p_dot, s2 * by.p_dot + s1 * s1 * by.p_ddot,
            s3 * by.p_dot + 3 * s1 * s2 * by.p_ddot + s1 * s1 * s1 * by.p_dddot};
  }
  double extent() const override { return pace_.duration(); }
  std::vector<double> points() const override {
    std::vector<double> times;
    for (const double distance : distances_) times.push_back(pace_.timeAt(distance / curve_.length()));
    return times;
  }

 private:
  Curve curve_;
  std::vector<double> distances_;
  Pace pace_;
};

// Limits of files.
constexpr std::size_t kLargestTable = 100000000;        // [bytes]
constexpr std::size_t kMaxPoints = 1000000;
constexpr double kMaxCoordinate = 1e4, kMaxTime = 1e7;  // [m], [s]

void require(bool good, const char* message) {
  if (!good) throw std::invalid_argument(message);
}

constexpr std::size_t kMaxCells = 3;

/// The cells of a line of a CSV file, NaN if not a number: at most kMaxCells, and one more if the
/// line continues.
struct Cells {
  std::array<double, kMaxCells + 1> values{};
  std::size_t count = 0;
};

bool isBlank(char c) { return std::isspace(static_cast<unsigned char>(c)) != 0; }

/// Parses a decimal number between blanks; NaN for anything else.
double numberIn(const char* begin, const char* end) {
  while (begin < end && isBlank(*begin)) ++begin;
  while (begin < end && isBlank(end[-1])) --end;
  constexpr char kDecimal[] = "+-.0123456789eE";  // strtod would also accept hexadecimal and "nan"
  const bool decimal =
      std::all_of(begin, end, [&](char c) { return std::strchr(kDecimal, c) != nullptr && c != 0; });
  char* stop = nullptr;
  const double value = decimal && begin < end ? std::strtod(begin, &stop) : 0;
  return stop == end ? value : std::numeric_limits<double>::quiet_NaN();
}

/// The character at `end` must not be part of a number.
Cells cellsOf(const char* begin, const char* end) {
  Cells cells;
  while (cells.count <= kMaxCells) {
    const char* comma = std::find(begin, end, ',');
    cells.values[cells.count++] = numberIn(begin, comma);
    if (comma == end) break;
    begin = comma + 1;
  }
  return cells;
}

bool turns(double rate) { return std::isfinite(rate) && rate != 0; }

/// The lines of a text, one after the other.
class Lines {
 public:
  explicit Lines(const std::string& text) : next_(text.data()), end_(next_ + text.size()) {}

  bool left() const { return next_ < end_; }
  std::pair<const char*, const char*> take() {
    const char* const begin = next_;
    const char* const stop = std::find(begin, end_, '\n');
    next_ = stop == end_ ? end_ : stop + 1;
    return {begin, stop};
  }

 private:
  const char* next_;
  const char* end_;  ///< the terminating 0
};

/// Whether the header has a column of times; calls fail() on an unknown header.
template <class Fail>
bool timedColumns(const std::pair<const char*, const char*>& line, const Fail& fail) {
  std::string columns(line.first, line.second);
  columns.erase(std::remove_if(columns.begin(), columns.end(), isBlank), columns.end());
  const bool timed = columns == "time,x,y";
  if (!timed && columns != "x,y")
    fail(1, "the columns must be time,x,y or x,y, not '" + columns.substr(0, 80) + "'");
  return timed;
}

/// The rows of a reference file.
struct PointRows {
  bool timed;
  Vector2<double> origin;
  std::vector<double> times;
  std::vector<Vector2<double>> points;

  /// Adds a row; returns an error message, or an empty string.
  std::string add(const Cells& cells) {
    const std::size_t width = timed ? 3 : 2;
    const double time = timed ? cells.values[0] : 0;
    const double x = cells.values[width - 2], y = cells.values[width - 1];
    if (cells.count != width || !std::isfinite(time + x + y))
      return std::string("it needs ") + (timed ? "three" : "two") + " finite numbers";
    if (std::abs(x) > kMaxCoordinate || std::abs(y) > kMaxCoordinate || std::abs(time) > kMaxTime)
      return "no room is 10 km wide, and no craft flies for months";
    const std::string wrong = wrongOrder(time, origin + Vector2<double>(x, y));
    if (!wrong.empty()) return wrong;
    times.push_back(time);
    points.push_back(origin + Vector2<double>(x, y));
    return "";
  }

  std::string wrongOrder(double time, const Vector2<double>& point) const {
    if (points.size() == kMaxPoints)
      return "it has more than " + std::to_string(kMaxPoints) + " points";
    if (points.empty()) return "";
    if (timed && time <= times.back()) return "times must ascend";
    if (!timed && points.back() == point) return "the point is the same as the one before";
    return "";
  }
};

}  // namespace

std::vector<double> checkTimes(const ReferenceTrajectory& reference, double extents) {
  constexpr double kLongestStep = 0.05, kFewest = 5000, kMost = 400000;
  std::vector<double> marks = reference.points();
  if (marks.empty()) marks = {0, extents * reference.extent()};
  const double end = marks.back(), step = end / std::clamp(end / kLongestStep, kFewest, kMost);
  std::vector<double> times = {marks.front()};
  for (std::size_t i = 1; i < marks.size(); ++i) {
    const double begin = marks[i - 1], length = marks[i] - begin;
    const double pieces = std::max(1.0, std::ceil(length / step - 1e-9));
    for (double k = 1; k <= pieces; ++k) times.push_back(begin + length * k / pieces);
  }
  return times;
}

ReferencePtr makePoint(const Vector2<double>& point) { return std::make_shared<StandingStill>(point); }

ReferencePtr makeCircle(const Vector2<double>& centre, double radius, double rate) {
  require(radius > 0 && turns(rate), "a circle needs a positive radius and a rate other than 0");
  return std::make_shared<Circle>(centre, radius, rate);
}

ReferencePtr makeLine(const Vector2<double>& start, const Vector2<double>& end, double speed,
                      bool smooth) {
  require(speed > 0 && (end - start).norm() > 0,
          "a line needs a positive speed and two different ends");
  return std::make_shared<Line>(start, end, speed, smooth);
}

ReferencePtr makeRhodonea(const Vector2<double>& centre, double amplitude, double petals,
                          double rate) {
  require(amplitude > 0 && std::isfinite(petals) && turns(rate),
          "a rhodonea needs a positive size and a rate other than 0");
  return std::make_shared<Rhodonea>(centre, amplitude, petals, rate);
}

ReferencePtr makeSinusoid(const Vector2<double>& start, double speed, double amplitude,
                          double rate) {
  require(std::isfinite(speed) && std::isfinite(amplitude) && turns(rate),
          "a sinusoid needs a rate other than 0");
  return std::make_shared<Sinusoid>(start, speed, amplitude, rate);
}

ReferencePtr makeSpline(const std::vector<double>& times,
                        const std::vector<Vector2<double>>& points) {
  require(points.size() >= 2 && points.size() == times.size(),
          "a spline needs at least two points");
  require(times.front() == 0, "the first point of a spline must be at time 0");
  for (std::size_t i = 1; i < times.size(); ++i)
    require(times[i] > times[i - 1] && std::isfinite(times[i]), "times must ascend");
  return std::make_shared<TimedSpline>(times, points);
}

ReferencePtr makeWaypoints(const std::vector<Vector2<double>>& points, double speed, bool smooth) {
  require(points.size() >= 2, "a way needs at least two points");
  require(speed > 0, "a way needs a positive speed");
  std::vector<double> distances = {0};
  for (std::size_t i = 1; i < points.size(); ++i) {
    distances.push_back(distances.back() + (points[i] - points[i - 1]).norm());
    require(distances[i] > distances[i - 1], "a way needs neighbouring points to be different");
  }
  return std::make_shared<Waypoints>(distances, points, speed, smooth);
}

ReferencePtr readReference(const std::string& path, const Vector2<double>& origin, double speed,
                           bool smooth) {
  if (path.empty()) throw std::runtime_error("parameter file is empty: set it to a CSV file");
  const std::string text = readTextFile(path, kLargestTable);
  const auto fail = [&](int line, const std::string& what) {
    throw std::runtime_error(path + ", line " + std::to_string(line) + ": " + what);
  };
  Lines lines(text);
  PointRows rows{timedColumns(lines.take(), fail), origin, {}, {}};
  for (int line = 2; lines.left(); ++line) {
    const auto [begin, stop] = lines.take();
    if (std::all_of(begin, stop, isBlank)) continue;
    const std::string wrong = rows.add(cellsOf(begin, stop));
    if (!wrong.empty()) fail(line, wrong);
  }
  if (rows.points.size() < 2) fail(1, "at least two points must follow");
  if (!rows.timed) return makeWaypoints(rows.points, speed, smooth);
  const double start = rows.times.front();
  for (double& time : rows.times) time -= start;
  return makeSpline(rows.times, rows.points);
}

const Tunables<ReferenceParams>& ReferenceParams::table() {
  using P = ReferenceParams;
  static const Tunables<P> table = {
      {{"x", "m", "Centre, start or origin, world_ned", -100, 100},
       [](auto& p) -> auto& { return p.origin.x(); }},
      {{"y", "m", "Centre, start or origin, world_ned", -100, 100},
       [](auto& p) -> auto& { return p.origin.y(); }},
      {{"size", "m", "Radius or amplitude", 0.01, 100}, &P::size},
      {{"rate_of_turn", "rad/s", "Angular rate of the reference", -10, 10}, &P::rate_of_turn},
      {{"petals", "-", "Rhodonea: rate of the radius per rate of turn", 0, 20}, &P::petals},
      {{"speed", "m/s", "Line, sinusoid, waypoints: speed", 0.001, 20}, &P::speed},
      {{"end_x", "m", "Line: end, world_ned", -100, 100},
       [](auto& p) -> auto& { return p.end.x(); }},
      {{"end_y", "m", "Line: end, world_ned", -100, 100},
       [](auto& p) -> auto& { return p.end.y(); }},
      {{"smooth", "", "Line, waypoints: start and stop smoothly"}, &P::smooth},
      {{"file", "s, m", "CSV with columns time,x,y or x,y"}, &P::file},
  };
  return table;
}

bool ReferenceParams::operator==(const ReferenceParams& other) const {
  const Tunables<ReferenceParams>& all = table();
  return kind == other.kind && std::all_of(all.begin(), all.end(), [&](const auto& one) {
           return one.get(*this) == one.get(other);
         });
}

const std::vector<ReferenceInfo>& referenceTable() {
  using P = const ReferenceParams&;
  static const std::vector<ReferenceInfo> table = {
      {"circle", "Centre x, y; size is the radius", {"x", "y", "size", "rate_of_turn"}, false,
       [](P p) { return makeCircle(p.origin, p.size, p.rate_of_turn); }},
      {"line", "From x, y to end_x, end_y at speed, then stop",
       {"x", "y", "end_x", "end_y", "speed", "smooth"}, true,
       [](P p) { return makeLine(p.origin, p.end, p.speed, p.smooth); }},
      {"rhodonea", "Rose curve about x, y", {"x", "y", "size", "petals", "rate_of_turn"}, false,
       [](P p) { return makeRhodonea(p.origin, p.size, p.petals, p.rate_of_turn); }},
      {"sinusoid", "From x, y along x; size is the amplitude",
       {"x", "y", "speed", "size", "rate_of_turn"}, false,
       [](P p) { return makeSinusoid(p.origin, p.speed, p.size, p.rate_of_turn); }},
      {"file", "CSV with columns time,x,y or x,y", {"file", "x", "y", "speed", "smooth"}, true,
       [](P p) { return readReference(p.file, p.origin, p.speed, p.smooth); }},
  };
  return table;
}

ReferencePtr makeReference(const ReferenceParams& params) {
  const ReferenceInfo* const info = findNamed(referenceTable(), params.kind);
  if (!info)
    throw std::invalid_argument("reference must be one of " + namesOf(referenceTable()) +
                                ", not '" + params.kind + "'");
  const auto& takes = info->takes;
  for (const Tunable<ReferenceParams>& one : ReferenceParams::table()) {
    if (std::find(takes.begin(), takes.end(), one.name) == takes.end()) continue;
    const std::string wrong = one.rangeError(one.get(params));
    if (!wrong.empty()) throw std::invalid_argument(wrong);
  }
  return info->make(params);
}

}  // namespace ground
