#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "ground/model/dynamics.h"
#include "ground/safety/room.h"

namespace ground {

/// Keeps a craft in a room: predicts where it comes to rest if thrust and lift are cut, and decides
/// when to cut them. Reads no clock.
///
/// The prediction is conservative: the craft moves straight at constant velocity for the age of the
/// state plus the room's latency; then friction of the floor brakes it. Drag is neglected. A thrust that
/// has acted since the state was measured counts if it takes the craft closer to a wall.
class Fence {
 public:
  /// A thrust since the state was measured.
  struct Thrust {
    Vector2<double> acceleration{0, 0};  ///< body axes [m/s^2]
    double duration = 0;                 ///< until the next command [s]
  };
  using Thrusts = std::vector<Thrust>;  ///< one after the other, from the time of the state on
  /// Loss of the mocap that should not end a drive; plans leave room for it [s].
  static constexpr double kLoss = 0.3;

  /// distance: smallest distance to the walls [m].
  Fence(Room room, double distance) : room_(std::move(room)), distance_(distance) {}

  const Room& room() const { return room_; }
  /// Where the craft comes to rest if thrust and lift are cut now; `age`: age of the state [s]. Of the
  /// thrusts the first `count` act, the last of which lasts on for the room's latency.
  Vector2<double> stoppingPoint(const RigidState<double>& state, double age, const Thrusts& thrusts = {},
                                std::size_t count = 0) const;
  /// By how much stoppingPoint() is too close to a wall [m], at least 0. `derivative`: its derivatives by x,
  /// y, psi, u, v, set only if it is positive.
  double violation(const RigidState<double>& state, double age,
                   Eigen::Matrix<double, 1, 5>& derivative) const;
  /// Why thrust and lift have to be cut now; empty if the craft may continue.
  /// That a later thrust brakes an earlier one is not relied on.
  std::string objection(const RigidState<double>& state, double age, const Thrusts& thrusts = {}) const;

 private:
  double coasting(double speed, double age) const;

  Room room_;
  double distance_;
};

}  // namespace ground
