#pragma once

#include <cmath>
#include <vector>

#include "ground/model/thruster.h"

namespace ground {

/// What is known of the angle of one channel; effects may change it. Only the angle of a foil has more than
/// the first two.
template <typename T>
struct Steered {
  T scale{}, offset{};         ///< angle at input 1, without the offset; angle at input 0 [rad]
  T force{}, jet{};            ///< of Foil
  T own_square{}, own_sway{};  ///< square of Foil::own_speed; Foil::own_sway
  T own_side{};                ///< relative part of own_sway, more where the flow comes from port
};

/// What each channel of the layout steers; empty for a craft without angles.
template <typename T>
std::vector<Steered<T>> steeringOf(const ThrusterLayout& layout) {
  std::vector<Steered<T>> all;
  if (!layout.steers()) return all;
  for (const Thruster& one : layout.thrusters()) {
    const Foil& foil = one.foil;
    all.push_back({T(one.angle * M_PI / 180), T(one.offset * M_PI / 180), T(foil.force), T(foil.jet),
                   T(foil.own_speed * foil.own_speed), T(foil.own_sway), T(0.0)});
  }
  return all;
}

/// Cosine and sine of the angle of each channel; only channels of angles are set.
template <typename T>
struct Angles {
  Thrusters<T> c, s;

  Angles(const ThrusterLayout& layout, const std::vector<Steered<T>>& steering, const Thrusters<T>& input) {
    if (!layout.steers()) return;
    c = s = Thrusters<T>::zero(layout.size());
    for (const ThrusterLayout::Link& link : layout.links()) {
      const Steered<T>& one = steering[static_cast<std::size_t>(link.channel)];
      const Rotation<T> turned(T(one.scale * input(link.channel) + one.offset));
      c(link.channel) = turned.c;
      s(link.channel) = turned.s;
    }
  }
};

/// The square root of the size of x, with its sign. Without a derivative where x is 0.
template <typename T>
T signedRoot(const T& x) {
  using std::sqrt;
  constexpr double kTiny = 1e-18;
  const auto root = [&](const T& size) {
    return whereAbove(
        kTiny, size, [](const T& y) { return T(sqrt(y)); }, T(0.0));
  };
  return root(x) - root(T(-x));
}

/// The flow at a foil. With the speed of the craft along and across the foil's axis at its place, a and b,
/// and the thrust T of the stream's thruster,
///
///     q = own_speed^2 a |a| + jet max(T, 0);   f = sign(q) sqrt(|q|);
///     g = own_sway (b - own_side |b|)
///
/// f is the inflow along the axis: the speed of an ideal propeller's stream by momentum theory. The normal
/// force on a foil at the angle d is
///
///     F = c sqrt(f^2 + g^2) (f sin d + g cos d)
///
/// which is c V^2 sin(angle of attack) (Yasukawa and Yoshimura, Introduction of MMG standard method for ship
/// maneuvering predictions, J. Mar. Sci. Technol. 20, 2015, (21) to (27)). Without own speed it is
/// c jet T sin d.
template <typename T>
T normalForce(const Steered<T>& foil, const T& a, const T& b, const T& thrust, const T& c, const T& s) {
  using std::abs;
  const T g = foil.own_sway * (b - foil.own_side * abs(b));
  const T q = foil.own_square * a * abs(a) + foil.jet * notBelowZero(thrust);
  // The two factors are kept apart only where something flows across: q has no root's derivative at 0.
  if (isConstant(g) && valueOf(g) == 0.0) return foil.force * q * s;
  return foil.force * signedRoot(T(abs(q) + g * g)) * (signedRoot(q) * s + g * c);
}

/// Adds what the angles of a craft do to the wrench X, Y [N], N [N m] of thrusters that do not turn.
/// `nu`: velocity relative to the air or water, body; `l`: lever of the body [m].
template <typename T>
void addSteering(const ThrusterLayout& layout, const std::vector<Steered<T>>& steering,
                 const Angles<T>& angles, const Thrusters<T>& thrust, const Vector3<T>& nu, const T& l,
                 Vector3<T>& wrench) {
  for (const ThrusterLayout::Link& link : layout.links()) {
    const T &c = angles.c(link.channel), &s = angles.s(link.channel);
    const T x = l * link.x, y = l * link.y;
    T along, across;
    if (link.foil) {
      const T u = nu.x() - nu.z() * y, v = nu.y() + nu.z() * x;
      const T a = link.forward * u + link.starboard * v, b = link.forward * v - link.starboard * u;
      const T stream = link.thruster < 0 ? T(0.0) : thrust(link.thruster);
      const T normal = normalForce(steering[static_cast<std::size_t>(link.channel)], a, b, stream, c, s);
      along = -layout[link.channel].foil.drag * normal * s;
      across = -normal * c;
    } else {
      along = thrust(link.thruster) * (c - 1.0);
      across = thrust(link.thruster) * s;
    }
    const T X = link.forward * along - link.starboard * across;
    const T Y = link.starboard * along + link.forward * across;
    wrench(0) += X;
    wrench(1) += Y;
    wrench(2) += x * Y - y * X;
  }
}

}  // namespace ground
