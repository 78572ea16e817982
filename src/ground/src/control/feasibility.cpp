#include "ground/control/feasibility.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <stdexcept>
#include <vector>

#include "ground/control/allocation.h"
#include "ground/safety/fence.h"

namespace ground {
namespace {

constexpr double kExtents = 10;       // checked multiple of the extent, because a sinusoid is unlimited
constexpr double kTolerance = 0.01;   // relative to full thrust and to full moment
constexpr double kHeldFirst = 1e-5;   // weight of the moment if the thrust must hold
constexpr double kFreeSway = 1e-8;    // weight of the force to the side that a rudder's moment brings
constexpr int kDirections = 72;       // directions of a thrust that are tried
constexpr double kNegligible = 1e-3;  // relative to full thrust; with less, any heading is possible

/// What the thrusters of a craft can give.
class Limits {
 public:
  explicit Limits(const Model& model)
      : all_(*model.thrusters, model.body),
        held_(*model.thrusters, model.body, {1, model.thrusters->steers() ? kFreeSway : 1, kHeldFirst}),
        forward_(most({1, 0, 0})),
        backward_(most({-1, 0, 0})),
        full_moment_(std::max(most({0, 0, 1}), most({0, 0, -1}))) {
    sways_ = std::min(most({0, 1, 0}), most({0, -1, 0})) > kTolerance * model.body.k;
    if (model.thrusters->steers()) sways_ = sways_ && swaysAlone(model.body);
    for (int i = 0; i < kDirections && sways_; ++i) {
      const double angle = 2 * M_PI * i / kDirections;
      forward_ = std::max(forward_, most({std::cos(angle), std::sin(angle), 0}));
    }
  }

  double thrust() const { return forward_; }          ///< largest [N]
  double fullMoment() const { return full_moment_; }  ///< [N m]
  bool sways() const { return sways_; }               ///< pushes to both sides
  bool reverses() const { return backward_ > kTolerance * forward_; }
  double least() const { return reverses() ? -backward_ : 0; }  ///< smallest surge force [N]
  /// Largest moment to the side of `moment` while the thrust is `surge` [N m].
  double moment(double surge, double moment) const {
    return std::abs(held_.run({surge, 0, std::copysign(2 * full_moment_, moment)}).wrench.z());
  }

 private:
  /// Whether the thrusters push to both sides without turning the craft, as a rudder cannot.
  bool swaysAlone(const Body<double>& body) const {
    for (const double force : {-0.1 * body.k, 0.1 * body.k}) {
      const Vector3<double> given = all_.run({0, force, 0}).wrench;
      if (std::abs(given.y() - force) > 0.5 * std::abs(force)) return false;
    }
    return true;
  }
  double most(const Vector3<double>& along) const { return along.dot(all_.most(along).wrench); }

  Allocation all_, held_;
  double forward_, backward_, full_moment_;
  bool sways_ = false;
};

/// The instant at which a craft misses a reference most.
struct Worst {
  double excess = kTolerance;
  std::string message;

  template <typename... Args>
  void report(double by, const char* text, Args... args) {
    if (!(by > excess)) return;
    char buffer[240];
    std::snprintf(buffer, sizeof buffer, text, args...);
    *this = {by, buffer};
  }
};

struct Demand {
  double thrust = 0;  ///< size of the force along which the craft must head [N]
  double heading = 0, yaw_rate = 0;
  double surge = 0;  ///< force of the thrusters [N]
};

Demand demand(const ReferencePoint& at, const Body<double>& body) {
  const Vector2<double> push = body.m * at.p_ddot + body.Y_v * at.p_dot;
  const Vector2<double> change = body.m * at.p_dddot + body.Y_v * at.p_ddot;
  const double size = push.norm();
  if (size == 0) return {};
  const Vector2<double> along = push / size;
  return {size, std::atan2(push.y(), push.x()),
          (push.x() * change.y() - push.y() * change.x()) / (size * size),
          along.dot(body.m * at.p_ddot + body.X_u * at.p_dot)};
}

/// Judges the thrust at time t [s].
void judgeThrust(const Limits& limits, double surge, double t, Worst& worst) {
  const double excess = std::max(surge - limits.thrust(), limits.least() - surge);
  worst.report(excess / limits.thrust(),
               "at %.2f s it takes a thrust of %.3g N, and the thrusters give %.3g to %.3g N", t, surge,
               limits.least(), limits.thrust());
}

/// Judges the yaw moment at time t [s] with a thrust.
void judgeMoment(const Limits& limits, double moment, double surge, double t, Worst& worst) {
  const double limit = limits.moment(surge, moment);
  worst.report(
      (std::abs(moment) - limit) / limits.fullMoment(),
      "at %.2f s it takes a yaw moment of %.3g N m, but with a thrust of %.3g N the limit is %.3g N m", t,
      std::abs(moment), surge, limit);
}

}  // namespace

std::string infeasibility(const ReferenceTrajectory& reference, const Model& model) {
  const Body<double>& body = model.body;
  const Limits limits(model);
  const std::vector<double> times = checkTimes(reference, 1);
  Worst worst;
  Demand last;
  double last_time = 0;
  bool backwards = false;
  for (std::size_t i = 1; i < times.size(); ++i) {
    const double h = times[i] - times[i - 1], t = times[i - 1] + 0.5 * h;
    const Demand now = demand(reference.at(t), body);
    if (now.thrust < kNegligible * limits.thrust()) continue;
    if (limits.sways()) {
      judgeThrust(limits, now.thrust, t, worst);
      continue;
    }
    // The heading follows the force. A jump of the heading would take an infinite moment, unless
    // the thrust is reversed.
    double turned = std::abs(wrapAngle(now.heading - last.heading));
    if (last.thrust > 0 && turned > M_PI / 2 && limits.reverses()) {
      backwards = !backwards;
      turned = M_PI - turned;
    }
    if (last.thrust > 0 && turned > 1 && t - last_time < 0.25)
      worst.report(10 + turned, "at %.2f s the craft would have to turn by %.0f degrees within %.2f s", t,
                   turned * 180 / M_PI, t - last_time);
    const double surge = backwards ? -now.surge : now.surge;
    judgeThrust(limits, surge, t, worst);
    const double before = demand(reference.at(t - h / 4), body).yaw_rate;
    const double after = demand(reference.at(t + h / 4), body).yaw_rate;
    const double moment = body.I_z * (after - before) / (h / 2) + body.N_r * now.yaw_rate;
    judgeMoment(limits, moment, surge, t, worst);
    last = now;
    last_time = t;
  }
  return worst.message.empty() ? "" : "the craft cannot follow it exactly: " + worst.message;
}

std::string leavesRoom(const ReferenceTrajectory& reference, const Room& room) {
  const std::string wrong = room.validate();
  if (!wrong.empty()) throw std::invalid_argument(wrong);
  const Fence fence(room, room.margin);
  double least = std::numeric_limits<double>::infinity(), when = 0;
  for (const double t : checkTimes(reference, kExtents)) {
    const ReferencePoint point = reference.at(t);
    RigidState<double> state{Vector3<double>::Zero(), Vector3<double>::Zero()};
    state.eta.head<2>() = point.p;
    state.nu.head<2>() = point.p_dot;  // at heading 0, body and world axes agree
    const Vector2<double> stop = fence.stoppingPoint(state, Fence::kLoss);
    const double clearance = std::min(room.clearance(point.p), room.clearance(stop));
    if (clearance >= least) continue;
    least = clearance;
    when = t;
  }
  if (least >= room.margin) return "";
  char text[200];
  std::snprintf(text, sizeof text,
                "after %.1f s it is too close to a wall, or too fast near one: a craft that is stopped there "
                "comes to rest %.2f m %s",
                when, std::abs(least), least < 0 ? "outside" : "from the wall");
  return text;
}

std::string leavesRoom(const ReferenceParams& params, const ReferenceTrajectory& reference,
                       const Room& room) {
  std::string problem = leavesRoom(reference, room);
  const auto& kinds = referenceTable();
  const auto kind = std::find_if(kinds.begin(), kinds.end(),
                                 [&](const ReferenceInfo& info) { return info.name == params.kind; });
  const std::vector<std::string> takes = kind == kinds.end() ? std::vector<std::string>() : kind->takes;
  if (problem.empty() || std::find(takes.begin(), takes.end(), "size") == takes.end()) return problem;
  constexpr double kStep = 0.01;  // [m]
  int fits = 0, fails = static_cast<int>(std::ceil(params.size / kStep));
  while (fails - fits > 1) {
    const int middle = (fits + fails) / 2;
    ReferenceParams smaller = params;
    smaller.size = middle * kStep;
    (leavesRoom(*makeReference(smaller), room).empty() ? fits : fails) = middle;
  }
  if (fits == 0) return problem + "; no size fits here at this rate and speed";
  char text[60];
  std::snprintf(text, sizeof text, "; the largest size that fits is %.2f m", fits * kStep);
  return problem + text;
}

}  // namespace ground
