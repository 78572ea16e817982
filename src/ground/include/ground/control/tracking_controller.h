#pragma once

#include "ground/control/fence.h"
#include "ground/control/reference_trajectory.h"
#include "ground/model/dynamics.h"

namespace ground {

/// What a controller decides upon.
struct Observation {
  double now = 0;            ///< when the command will be given [s]
  double stamp = 0;          ///< when the state was measured, at most `now` [s]
  RigidState<double> state;  ///< as measured
  const ReferenceTrajectory* reference = nullptr;
  double reference_start = 0;  ///< time at which the reference begins [s]
  double lift = 1;             ///< input of the lift fan, 0..1
  double drive_start = 0;      ///< when the drive began: the origin of the model's t [s]
};

/// Follows a reference: state in, inputs out. One thread at a time.
class TrackingController {
 public:
  virtual ~TrackingController() = default;
  /// A run begins: forgets what was measured and planned.
  virtual void reset() {}
  /// Every command that went out, whoever gave it; in order of time [s], in the model's units.
  virtual void commanded(double /*time*/, const Vector2<double>& /*thrusters*/, double /*lift*/) {}
  /// Walls to keep away from; a controller that makes no plans takes no heed of them.
  virtual void avoid(const PlanWalls& /*walls*/) {}
  /// Whether it follows the reference at all.
  virtual bool follows() const { return true; }
  /// Where it takes the point to be that follows the reference, world_ned [m], when this pose and
  /// velocity are measured.
  virtual Vector2<double> position(const RigidState<double>& measured) const {
    return measured.eta.head<2>();
  }
  /// Inputs left, right, in the model's units, inside 0..input_max; not finite when it is at a
  /// loss.
  virtual Vector2<double> decide(const Observation& observation) = 0;
  /// Inputs left, right that the last decision wanted before they were limited to 0..input_max, in
  /// the model's units: where it does not saturate, those that it gave.
  virtual Vector2<double> wanted() const = 0;
};

}  // namespace ground
