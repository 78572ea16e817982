#include "ground/control/reference_trajectory.h"

#include <cmath>
#include <complex>
#include <stdexcept>

namespace ground {
namespace {

using Complex = std::complex<double>;

/// Adds a exp(i w t), a turning pointer in the plane, and its derivatives.
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

class Line : public ReferenceTrajectory {
 public:
  Line(const Vector2<double>& start, const Vector2<double>& end, double speed, bool smooth)
      : start_(start), way_(end - start), smooth_(smooth) {
    // The smooth profile's peak is 35/16 of its mean speed.
    duration_ = way_.norm() / speed * (smooth ? 35.0 / 16.0 : 1.0);
  }
  ReferencePoint at(double t) const override {
    if (t >= duration_) return ground::at(start_ + way_);
    const double x = t / duration_, d = 1 / duration_;
    if (!smooth_) {
      ReferencePoint point = ground::at(start_ + x * way_);
      point.p_dot = d * way_;
      return point;
    }
    // 35 x^4 - 84 x^5 + 70 x^6 - 20 x^7: velocity, acceleration and jerk vanish at both ends.
    const double x2 = x * x, x3 = x2 * x;
    const double s = x2 * x2 * (35 + x * (-84 + x * (70 - 20 * x)));
    const double s1 = 140 * x3 * (1 + x * (-3 + x * (3 - x)));
    const double s2 = 420 * x2 * (1 + x * (-4 + x * (5 - 2 * x)));
    const double s3 = 840 * x * (1 + x * (-6 + x * (10 - 5 * x)));
    return {start_ + s * way_, d * s1 * way_, d * d * s2 * way_, d * d * d * s3 * way_};
  }
  double extent() const override { return duration_; }

 private:
  Vector2<double> start_, way_;
  double duration_;
  bool smooth_;
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

void require(bool good, const char* message) {
  if (!good) throw std::invalid_argument(message);
}

bool turns(double rate) { return std::isfinite(rate) && rate != 0; }

}  // namespace

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

ReferencePtr makeReference(const ReferenceParams& p) {
  if (p.kind == "circle") return makeCircle(p.origin, p.size, p.rate_of_turn);
  if (p.kind == "line") return makeLine(p.origin, p.end, p.speed, p.smooth);
  if (p.kind == "rhodonea") return makeRhodonea(p.origin, p.size, p.petals, p.rate_of_turn);
  if (p.kind == "sinusoid") return makeSinusoid(p.origin, p.speed, p.size, p.rate_of_turn);
  throw std::invalid_argument("reference must be circle, line, rhodonea or sinusoid, not '" +
                              p.kind + "'");
}

}  // namespace ground
