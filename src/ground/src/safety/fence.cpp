#include "ground/safety/fence.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace ground {

double Fence::coasting(double speed, double age) const {
  return std::max(0.0, age) + room_.latency + 0.5 * speed / room_.braking;
}

Vector2<double> Fence::stoppingPoint(const RigidState<double>& state, double age, const Thrusts& thrusts,
                                     std::size_t count) const {
  Vector2<double> at = state.eta.head<2>();
  Vector2<double> velocity = bodyToWorld<double>(state.eta.z(), state.nu.head<2>().eval());
  double time = 0;
  for (std::size_t i = 0; i < count; ++i) {
    const double lasts = thrusts[i].duration + (i + 1 == count ? room_.latency : 0);
    const double heading = state.eta.z() + (time + 0.5 * lasts) * state.nu.z();  // half way through it
    const Vector2<double> gained = lasts * bodyToWorld<double>(heading, thrusts[i].acceleration);
    at += lasts * (velocity + 0.5 * gained);
    velocity += gained;
    time += lasts;
  }
  const double glides = std::max(0.0, std::max(0.0, age) + room_.latency - time);
  return at + (glides + 0.5 * velocity.norm() / room_.braking) * velocity;
}

double Fence::violation(const RigidState<double>& state, double age,
                        Eigen::Matrix<double, 1, 5>& derivative) const {
  Vector2<double> away;
  const double violation = distance_ - room_.clearance(stoppingPoint(state, age), away);
  if (!(violation > 0)) return 0;
  const Rotation<double> heading(state.eta.z());
  const Vector2<double> velocity = heading.toWorld(state.nu.head<2>().eval());
  const double speed = velocity.norm(), time = coasting(speed, age);
  Eigen::Matrix<double, 2, 5> rest_by;
  rest_by << 1, 0, -time * velocity.y(), time * heading.c, -time * heading.s,  //
      0, 1, time * velocity.x(), time * heading.s, time * heading.c;
  if (speed > 0)
    rest_by.rightCols<2>() += 0.5 / (room_.braking * speed) * velocity * state.nu.head<2>().transpose();
  derivative = -away.transpose() * rest_by;
  return violation;
}

std::string Fence::objection(const RigidState<double>& state, double age, const Thrusts& thrusts) const {
  const Vector2<double> here = state.eta.head<2>();
  const double now = room_.clearance(here);
  char text[160] = "";
  if (now < 0) {
    std::snprintf(text, sizeof text, "the craft is %.2f m outside of the room", -now);
  } else if (now < distance_) {
    std::snprintf(text, sizeof text, "the craft is %.2f m from a wall of the room", now);
  } else {
    double then = now;
    for (std::size_t count = 0; count <= thrusts.size(); ++count)
      then = std::min(then, room_.clearanceOfWay(here, stoppingPoint(state, age, thrusts, count)));
    if (then < distance_)
      std::snprintf(text, sizeof text,
                    "the craft would come to rest %.2f m %s of the room if it were stopped later",
                    std::abs(then), then < 0 ? "outside" : "from a wall");
  }
  return text;
}

}  // namespace ground
