// What the documentation promises of the fence, on a line, as a second implementation.
#pragma once

#include <algorithm>
#include <optional>
#include <vector>

#include "ground/safety/fence.h"

namespace ground {
namespace search {

struct FenceSpec {
  static constexpr double kAhead = 1;  ///< [s]

  /// A state, as far as it matters.
  struct Seen {
    double stamp, x, u, heading;
    bool valid, finite;
    bool ahead = false;  ///< its stamp is of another clock
    double since = 0;    ///< from when on thrust counts: its stamp, or when it came if that was earlier

    bool trusted() const { return valid && finite && !ahead; }
  };
  /// Thrust from a time on, clock of stamps.
  struct Push {
    double since, acceleration;  ///< [s], [m/s^2]
  };

  Fence fence;
  std::optional<Seen> seen, trusted;  ///< the last state, and the last trusted one
  std::vector<Push> pushes;           ///< at the time of the last trusted state, and since then

  void measure(double now, Seen measured) {
    measured.ahead = measured.stamp > now + kAhead;
    measured.since = std::min(measured.stamp, now);
    seen = measured;
    if (!measured.trusted()) return;
    trusted = measured;
    while (pushes.size() > 1 && pushes[1].since <= measured.since) pushes.erase(pushes.begin());
  }
  /// Notes a command on the wire by the acceleration that it causes.
  void sends(double time, double acceleration) {
    if (!trusted) pushes.clear();
    if (pushes.empty() || pushes.back().acceleration != acceleration) pushes.push_back({time, acceleration});
  }
  void clockSet() {
    seen.reset();
    trusted.reset();
    pushes.clear();
  }
  /// Whether the craft could leave the room, by the last trusted state or the last one, and all thrust since.
  bool leaves(double time) const {
    return (trusted && leavesFrom(time, *trusted)) || (seen && seen->finite && leavesFrom(time, *seen));
  }

  template <class Visitor>
  void visit(Visitor&& v) const {
    for (const Push& one : pushes) {
      v.stamp(trusted ? std::max(one.since, trusted->since) : one.since);
      v.value(one.acceleration);
    }
    for (const bool flag : {seen && seen->valid, seen && seen->finite, seen && seen->ahead}) v.value(flag);
  }

 private:
  bool leavesFrom(double time, const Seen& from) const {
    Fence::Thrusts thrusts;
    for (std::size_t i = 0; i < pushes.size(); ++i) {
      const double until = i + 1 < pushes.size() ? pushes[i + 1].since : time;
      const double lasted = std::max(0.0, until - std::max(pushes[i].since, from.since));
      thrusts.push_back({{pushes[i].acceleration, 0}, lasted});
    }
    RigidState<double> craft{Vector3<double>(from.x, 0, from.heading), Vector3<double>(from.u, 0, 0)};
    return !fence.objection(craft, time - from.since, thrusts).empty();
  }
};

}  // namespace search
}  // namespace ground
