#pragma once

#include <algorithm>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "ground/model/dynamics.h"
#include "ground/model/pose_measurement.h"
#include "ground/safety/fence.h"

namespace ground {

/// State of the craft, estimated from the mocap.
struct MeasuredState {
  double stamp = 0;  ///< time of measurement, clock of stamps [s]
  RigidState<double> state;
  bool valid = false;
  std::string problem = {};                               ///< why it is not valid
  Vector3<double> nu_variance = Vector3<double>::Zero();  ///< variance of the velocities
  PoseMeasurement pose = {};                              ///< what was measured, before any filter

  bool finite() const { return state.eta.allFinite() && state.nu.allFinite(); }
};

/// Decides whether a craft has to be stopped to stay in its room: a Fence, the last states and the commands
/// since then. A controller's life cycle has one with the room's margin, for what it commands, so that it
/// stops first; the sender has one up to the walls, for what it really sends. Times are on the clock of
/// stamps [s].
///
///     guard.setFence(Fence(room, room.margin));
///     guard.state(now, measured);                               // every state
///     guard.sent(now, acceleration(drive.since(now), inputs));  // every command that leaves, zeros as well
///     const std::string why = guard.objection(now);             // before the next one, and between states
///
/// Without any state it has no objection: whether a state is lost is for StateLoss to say. An acceleration of
/// 0 for an unknown craft hides its thrust.
class FenceGuard {
 public:
  /// Without value, there are no bounds.
  void setFence(std::optional<Fence> fence) { fence_ = std::move(fence); }
  /// Call with every state. One whose stamp is ahead of `now` counts as measured now: thrust from now on acts
  /// upon it. One that is more than Freshness::kMaxAhead ahead is of another clock, and not valid.
  void state(double now, const MeasuredState& measured);
  /// Call with every command that is sent; `acceleration`: by its thrust, body axes [m/s^2]
  /// (ThrustAcceleration), 0 if the craft is unknown.
  void sent(double time, const Vector2<double>& acceleration);
  /// Call when the clock of stamps was set: what was seen and sent by it counts no more.
  void reset();
  /// Why the craft has to be stopped to stay inside; empty if it may continue. It carries on from the last
  /// valid state and, if that is another, from the last one, which may be where the craft is although it is
  /// invalid.
  std::string objection(double now) const;

  /// See GroundLink::visit.
  template <class Visitor>
  void visit(Visitor&& visitor) const {
    for (const std::optional<MeasuredState>* measured : {&last_, &valid_}) {
      visitor.value(measured->has_value());
      if (!*measured) continue;
      visitor.stamp((*measured)->stamp);
      visitor.value((*measured)->valid);
      for (int i = 0; i < 3; ++i) {
        visitor.value((*measured)->state.eta(i));
        visitor.value((*measured)->state.nu(i));
      }
    }
    for (const Thrust& one : thrusts_) {
      visitor.stamp(valid_ ? std::max(one.since, valid_->stamp) : one.since);
      for (const double a : one.acceleration) visitor.value(a);
    }
  }

 private:
  /// Thrust from a time on.
  struct Thrust {
    double since;
    Vector2<double> acceleration;  ///< [m/s^2]
  };
  std::string objection(double now, const MeasuredState& from) const;

  std::optional<Fence> fence_;
  std::optional<MeasuredState> last_, valid_;  ///< the last state, and the last valid and finite one
  std::vector<Thrust> thrusts_;                ///< at the time of valid_, and those since then
};

}  // namespace ground
