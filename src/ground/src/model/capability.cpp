#include "ground/model/capability.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace ground {
namespace {

constexpr double kLengths = 20;     // travelled at full thrust [radii of gyration]; some five lengths
constexpr double kTurn = 2 * M_PI;  // turned at full moment [rad]
constexpr double kNoThrust = 1e-9;  // of the largest force: an axis with less has no thrusters

/// Largest |X|, |Y|, |N| / l of the thrusters, each divided by k.
Vector3<double> largestWrench(const ThrusterLayout& layout, double full) {
  const int count = layout.size();
  Vector3<double> least = Vector3<double>::Zero(), most = Vector3<double>::Zero();
  Thrusters<double> input = Thrusters<double>::zero(count);
  if (layout.steers()) {  // a rudder needs the stream of its thruster
    const auto consider = [&](const Thrusters<double>& some) {
      most = most.cwiseMax(layout.atRest(some).cwiseAbs()).eval();
    };
    for (unsigned corner = 0; corner < 1U << static_cast<unsigned>(count); ++corner) {
      for (int i = 0; i < count; ++i)
        input(i) = full * ((corner >> static_cast<unsigned>(i)) & 1U ? layout[i].most : layout[i].least);
      consider(input);
      for (int i = 0; i < count; ++i)
        if (!layout.pushes(i)) input(i) = 0;  // an angle of half a turn pushes ahead at neither end
      consider(input);
    }
    for (const bool starboard : {false, true}) consider(fastestTurn(layout, starboard, full));
    return most;
  }
  for (int i = 0; i < count; ++i) {
    input(i) = full * layout[i].least;
    const Vector3<double> one = layout.atRest(input);
    input(i) = full * layout[i].most;
    const Vector3<double> other = layout.atRest(input);
    input(i) = 0;
    least += one.cwiseMin(other);
    most += one.cwiseMax(other);
  }
  return least.cwiseAbs().cwiseMax(most);
}

/// Largest force in one direction, without angles, divided by k input_max.
double strongest(const ThrusterLayout& layout) {
  double best = 0;
  for (int j = 0; j < layout.size(); ++j) {
    double along = 0;
    for (int i = 0; i < layout.size(); ++i) {
      if (!layout.pushes(i) || !layout.pushes(j)) continue;
      const double share = layout.forward(i) * layout.forward(j) + layout.starboard(i) * layout.starboard(j);
      const Thruster& one = layout[i];
      along += one.gain * std::max(share * one.curve.at(one.most), share * one.curve.at(one.least));
    }
    best = std::max(best, along);
  }
  return best;
}

}  // namespace

Capability capability(const ThrusterLayout& layout, const Body<double>& body) {
  return {body.k * largestWrench(layout, body.input_max).cwiseProduct(Vector3<double>(1, 1, body.l)),
          strongest(layout) * body.k * body.input_max};
}

double timeScale(const Model& model) {
  const Body<double>& body = model.body;
  const double way = kLengths * std::sqrt(body.I_z / body.m);
  const Vector3<double> ways(way, way, kTurn), mass(body.m, body.m, body.I_z),
      damping(body.X_u, body.Y_v, body.N_r), full = capability(model).wrench;
  double shortest = std::numeric_limits<double>::infinity();
  for (int i = 0; i < 3; ++i) {
    if (!(full(i) > kNoThrust * full.head<2>().maxCoeff())) continue;
    // The time t with mass 2 way / t^2 + damping way / t = full.
    const double half = 0.5 * ways(i) * damping(i) / full(i);
    shortest = std::min(shortest, half + std::sqrt(half * half + 2 * ways(i) * mass(i) / full(i)));
  }
  return std::isfinite(shortest) ? roundedTime(shortest) : 1;
}

double roundedTime(double seconds) {
  const double power = std::floor(std::log10(seconds));
  double best = 0, least = std::numeric_limits<double>::infinity();
  for (const double exponent : {power, power + 1}) {
    for (const double step : {1.0, 2.0, 5.0}) {
      const double near = step * std::pow(10.0, exponent), off = std::abs(std::log(near / seconds));
      if (off < least) {
        least = off;
        best = near;
      }
    }
  }
  return best;
}

}  // namespace ground
