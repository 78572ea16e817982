#include "ground/control/fence.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <stdexcept>

#include "ground/model/simulation.h"

namespace ground {
namespace {

constexpr double kExtents = 10;  // checked multiple of the extent, because a sinusoid is unlimited

bool takesSize(const std::string& kind) {
  for (const ReferenceInfo& info : referenceTable())
    if (info.name == kind) return std::count(info.takes.begin(), info.takes.end(), "size") > 0;
  return false;
}

}  // namespace

double Fence::coasting(double speed, double age) const {
  return std::max(0.0, age) + room_.latency + 0.5 * speed / room_.braking;
}

Vector2<double> Fence::stoppingPoint(const RigidState<double>& state, double age) const {
  const Vector2<double> velocity = bodyToWorld<double>(state.eta.z(), state.nu.head<2>().eval());
  return state.eta.head<2>() + coasting(velocity.norm(), age) * velocity;
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

std::string Fence::objection(const RigidState<double>& state, double age) const {
  const Vector2<double> here = state.eta.head<2>();
  const double now = room_.clearance(here);
  char text[160] = "";
  if (now < 0) {
    std::snprintf(text, sizeof text, "the craft is %.2f m outside of the room", -now);
  } else if (now < distance_) {
    std::snprintf(text, sizeof text, "the craft is %.2f m from a wall of the room", now);
  } else {
    const double then = room_.clearanceOfWay(here, stoppingPoint(state, age));
    if (then < distance_)
      std::snprintf(text, sizeof text,
                    "the craft would come to rest %.2f m %s of the room if it were stopped later",
                    std::abs(then), then < 0 ? "outside" : "from a wall");
  }
  return text;
}

std::string leavesRoom(const ReferenceTrajectory& reference, const Room& room) {
  struct Least {
    double clearance = std::numeric_limits<double>::infinity(), when = 0;
    void take(double other, double t) {
      if (other < clearance) *this = {other, t};
    }
  };
  const std::string wrong = room.validate();
  if (!wrong.empty()) throw std::invalid_argument(wrong);
  const Fence fence(room, room.margin);
  Least there, stopped;
  for (const double t : checkTimes(reference, kExtents)) {
    const ReferencePoint point = reference.at(t);
    RigidState<double> state{Vector3<double>::Zero(), Vector3<double>::Zero()};
    state.eta.head<2>() = point.p;
    state.nu.head<2>() = point.p_dot;  // at heading 0, body and world axes agree
    there.take(room.clearance(point.p), t);
    stopped.take(room.clearance(fence.stoppingPoint(state, Fence::kLoss)), t);
  }
  char text[200] = "";
  if (there.clearance < 0) {
    std::snprintf(text, sizeof text, "it leaves the room by %.2f m after %.1f s", -there.clearance,
                  there.when);
  } else if (there.clearance < room.margin) {
    std::snprintf(text, sizeof text, "it comes to %.2f m of a wall after %.1f s; margin is %.2f m",
                  there.clearance, there.when, room.margin);
  } else if (stopped.clearance < room.margin) {
    std::snprintf(text, sizeof text,
                  "after %.1f s it is too fast near a wall: a craft that is stopped there comes to "
                  "rest %.2f m %s",
                  stopped.when, std::abs(stopped.clearance),
                  stopped.clearance < 0 ? "outside" : "from the wall");
  }
  return text;
}

std::string leavesRoom(const ReferenceParams& params, const ReferenceTrajectory& reference,
                       const Room& room) {
  std::string reason = leavesRoom(reference, room);
  if (reason.empty() || !takesSize(params.kind)) return reason;
  const auto fits = [&](int hundredths) {
    ReferenceParams smaller = params;
    smaller.size = 0.01 * hundredths;
    return leavesRoom(*makeReference(smaller), room).empty();
  };
  int good = 0, bad = static_cast<int>(std::ceil(100 * params.size));
  while (bad - good > 1) {
    const int middle = (good + bad) / 2;
    (fits(middle) ? good : bad) = middle;
  }
  char text[40] = "; no size fits";
  if (good > 0) std::snprintf(text, sizeof text, "; size=%.2f fits", 0.01 * good);
  return reason + text;
}

std::string leavesRoom(const Model& model, const InputSequence& inputs, double end, const Room& room) {
  constexpr double kInterval = 0.05;  // [s]
  const Dynamics<double> dynamics(model);
  RigidState<double> start{Vector3<double>::Zero(), Vector3<double>::Zero()};
  start.eta.head<2>() = room.home;
  Simulation<double> simulation(dynamics, inputs, start, 0);
  for (double time = 0; time < end; time += kInterval) {
    simulation.advance(time);
    if (room.clearance(simulation.state().eta.head<2>()) >= room.margin) continue;
    char text[120];
    std::snprintf(text, sizeof text, "by the model it comes too close to a wall after %.1f s", time);
    return text;
  }
  return "";
}

}  // namespace ground
