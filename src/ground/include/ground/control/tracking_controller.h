#pragma once

#include <string>

#include "ground/control/plan_walls.h"
#include "ground/control/reference_trajectory.h"
#include "ground/control/time_budget.h"
#include "ground/model/dynamics.h"
#include "ground/model/inputs.h"
#include "ground/model/pose_measurement.h"

namespace ground {

/// What a controller knows of a state, and for its decision.
struct Observation {
  double now = 0;            ///< time at which the command will be given [s]
  double stamp = 0;          ///< time at which the state was measured, at most `now` [s]
  RigidState<double> state;  ///< measured state
  const ReferenceTrajectory* reference = nullptr;
  double reference_start = 0;  ///< time at which the reference begins [s]
  Conditions<double> given;    ///< lift and voltage from now on
  double drive_start = 0;      ///< start of the drive, at which the model's t is 0 [s]
  PoseMeasurement pose = {};   ///< what was measured, before any filter
};

/// Computes inputs from states to follow a reference. One thread at a time.
///
///     class Forward : public TrackingController {
///       Thrusters<double> decide(const Observation&) override { return wanted(); }
///       Thrusters<double> wanted() const override { return {0.1, 0.1}; }
///     };
///
/// The state is as old as the mocap's latency, and the inputs act later still. docs/architecture.md says how
/// to add a kind of controller. Nothing here stops a craft: ControllerLifecycle and the sender do.
class TrackingController {
 public:
  virtual ~TrackingController() = default;
  /// Called at the start of a run: discards measurements and plans.
  virtual void reset() {}
  /// Called with every command that is sent, by any controller, in order of time [s], in the
  /// model's units.
  virtual void commanded(double /*time*/, const Thrusters<double>& /*thrusters*/, double /*lift*/) {}
  /// Sets walls to avoid; a controller without plans ignores them.
  virtual void avoid(const PlanWalls& /*walls*/) {}
  /// Sets a steady clock [s], by which decisions keep their deadlines. Without one, and without
  /// deadlines, they take the time that they need.
  virtual void setClock(TimeBudget::Clock /*clock*/) {}
  /// Position of the point that follows the reference, world_ned [m], given the measured pose and
  /// velocity.
  virtual Vector2<double> position(const RigidState<double>& measured) const {
    return measured.eta.head<2>();
  }
  /// Called with every state, also with those between decisions.
  virtual void observe(const Observation& /*observation*/) {}
  /// Why it cannot work with what it has observed; empty if it can.
  virtual std::string objection() const { return ""; }
  /// Inputs of all thrusters, in the model's units and within their ranges; not finite if it cannot
  /// decide.
  virtual Thrusters<double> decide(const Observation& observation) = 0;
  /// Inputs of the last decision before they were limited to the ranges, in the model's units.
  virtual Thrusters<double> wanted() const = 0;
};

}  // namespace ground
