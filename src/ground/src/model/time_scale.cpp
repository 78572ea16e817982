#include "ground/model/time_scale.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "ground/model/capability.h"

namespace ground {
namespace {

constexpr double kLengths = 20;     // travelled at full thrust [radii of gyration]; some five lengths
constexpr double kTurn = 2 * M_PI;  // turned at full moment [rad]
constexpr double kNoThrust = 1e-9;  // of the largest force: an axis with less has no thrusters

}  // namespace

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
