#pragma once

#include <string>

#include "ground/control/reference_trajectory.h"
#include "ground/control/room_plan.h"
#include "ground/model/dynamics.h"

namespace ground {

/// Keeps a craft in a room: predicts where it comes to rest when thrust and lift are cut, and says
/// when it is time to do so. Free of clocks.
///
/// The craft goes straight on for the room's latency and for as long as the state is old, and is
/// then braked by the floor. What its drag would take away is not counted.
class Fence {
 public:
  /// distance: what has to be left to the walls [m].
  Fence(RoomPlan room, double distance) : room_(std::move(room)), distance_(distance) {}

  const RoomPlan& room() const { return room_; }
  /// Where the craft comes to rest if it is cut now; `age`: of the state [s].
  Vector2<double> rest(const RigidState<double>& state, double age) const;
  /// By how much rest() is too close to a wall [m], 0 where it is not; `derivative`: its derivatives by
  /// x, y, psi, u, v, set where it is positive.
  double excess(const RigidState<double>& state, double age,
                Eigen::Matrix<double, 1, 5>& derivative) const;
  /// Why the craft has to be cut now; empty as long as it may go on.
  std::string objection(const RigidState<double>& state, double age) const;

 private:
  double coasting(double speed, double age) const;

  RoomPlan room_;
  double distance_;
};

/// Why a reference does not fit into a room, its margin included; empty when it does.
std::string leavesRoom(const ReferenceTrajectory& reference, const RoomPlan& room);

}  // namespace ground
