#pragma once

#include <string>

#include "ground/control/reference_trajectory.h"
#include "ground/control/room_plan.h"
#include "ground/model/dynamics.h"
#include "ground/model/stepping.h"

namespace ground {

/// Keeps a craft in a room: predicts where it comes to rest when thrust and lift are cut, and says
/// when it is time to do so. Free of clocks.
///
/// The craft goes straight on for the room's latency and for as long as the state is old, and is
/// then braked by the floor. What its drag would take away is not counted.
class Fence {
 public:
  /// A loss of the mocap that shall not end a drive: plans leave room for it [s].
  static constexpr double kLoss = 0.3;

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

/// Walls that a plan avoids: it costs when the craft would be too close to one after thrust and lift
/// were cut.
struct PlanWalls {
  Fence fence;
  double age = 0;       ///< of the state when that happens: for how long the mocap is lost [s]
  double weight = 100;  ///< of the square of Fence::excess
};

/// Why a craft on a reference could not be stopped inside a room, its margin included, were the mocap
/// lost for Fence::kLoss; empty when it could.
std::string leavesRoom(const ReferenceTrajectory& reference, const RoomPlan& room);
/// Where open-loop inputs (in the model's units, until `end` [s]) take a craft by its model, from rest
/// at home: why it does not stay inside; empty when it does.
std::string leavesRoom(const Model& model, const InputSequence& inputs, double end,
                       const RoomPlan& room);

}  // namespace ground
