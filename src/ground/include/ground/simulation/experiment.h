#pragma once

#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "ground/control/controller_lifecycle.h"
#include "ground/control/controllers.h"
#include "ground/control/excitation_pilot.h"
#include "ground/control/reference_trajectory.h"
#include "ground/estimation/motion_filter.h"
#include "ground/simulation/room.h"

namespace ground {

/// What may go wrong with the craft: commands do not reach it, reach the wrong thrusters, or reach
/// all but one thruster or the lift fan.
enum class CraftFault { kDeaf, kSwapped, kLeftOff, kRightOff, kNoLift };

/// Craft and mocap of an experiment; its clock starts at 0 s.
struct ExperimentParams {
  RigidState<double> initial;  ///< of the craft
  MocapParams mocap;
  unsigned long seed = 1;  ///< of the mocap's noise and losses, and of the disturbance
  /// What goes wrong, from when until when [s].
  CraftFault fault = CraftFault::kDeaf;
  double fault_from = std::numeric_limits<double>::infinity();
  double fault_until = std::numeric_limits<double>::infinity();
  /// Acts on the craft; that of the model does not.
  Disturbance disturbance = {};
};

/// A controller as the nodelets run it, on the states that the estimator makes of the delivered
/// frames.
struct DriveParams {
  EstimatorParams estimator;
  bool estimate = true;    ///< otherwise what an exact mocap sees at the frames' captures
  /// Defaults of the tracking nodelets, except that no sender has to be armed.
  LifecycleParams life = {1.0, 1.0, 0.2, 0.5, 50.0, false};
  double start = 0.5;      ///< of the controller; lift on, or later when there is no valid state [s]
  double duration = 20.0;  ///< of driving [s]
  double tail = 0.5;       ///< recorded after the end [s]
  std::optional<RoomPlan> room;  ///< in which the life cycle keeps the craft

  std::string validate() const;  ///< what is wrong; empty when nothing is
};

/// A controller that follows a reference.
struct TrackingParams : DriveParams {
  ReferenceParams reference;
  ControllerChoice controller;
  /// Error beyond which TrackingWatch stops it [m]; 0: defaultMaxError, infinite: never.
  double max_error = 0;

  std::string validate() const;  ///< what is wrong; empty when nothing is
};

/// An input design; with a room, in bursts between returns to its home.
struct ExcitationParams : DriveParams {
  DesignParams design;
  ReturnParams returns;  ///< but for the room, which is `room`

  std::string validate() const;  ///< what is wrong; empty when nothing is
};

/// What a recorder notes of an experiment, and the truth that only a simulator knows.
struct ExperimentLog {
  struct Command {
    double time;               ///< at which it is issued and reaches the craft [s]
    double left, right, lift;  ///< 0..1
  };
  struct Truth {
    double time;  ///< [s]
    RigidState<double> state;
    Vector3<double> nu_dot;       ///< body [m/s^2, m/s^2, rad/s^2]
    RigidState<double> measured;  ///< what an exact mocap makes of the state
    Vector3<double> wrench;       ///< of the disturbance: X, Y [N], N [N m], body
  };
  struct Decision {
    double time;                ///< [s]
    double stamp;               ///< of the state by which it was made [s]
    Vector2<double> thrusters;  ///< inputs, in the model's units
    Vector2<double> wanted;     ///< the same before they were limited
    double computing;           ///< time of the processor that it took [s]
  };
  struct Stage {
    double time;  ///< at which it begins [s]
    ControllerLifecycle::State state;
    std::string reason;
  };
  struct Reference {
    double time;  ///< stamp of the state that was compared with it [s]
    ReferencePoint point;
  };

  std::vector<MocapFrame> frames;  ///< in the order of delivery; psi in (-pi, pi]
  std::vector<Command> commands;
  std::vector<Truth> truth;           ///< at every frame's capture, also of lost frames
  std::vector<Reference> references;  ///< when tracking
  std::vector<Decision> decisions;    ///< when tracking or returning home
  std::vector<Stage> stages;          ///< of the controller's life, when one drives
  std::vector<ExcitationPilot::Mark> marks;  ///< bursts and returns of an excitation
  std::string stopped;    ///< why the controller stopped before its end; empty when it did not
  double stopped_at = 0;  ///< when it did [s]
};

/// Plays commands, repeated every 20 ms as the open-loop controller does, for `duration` [s].
/// Inputs of `schedule` are 0..1. Runs in lockstep: the same arguments give the same log, bit by
/// bit. Throws std::invalid_argument on bad parameters, std::runtime_error when the state is no
/// longer finite.
ExperimentLog playSchedule(const Model& model, const InputSequence& schedule, double duration,
                           const ExperimentParams& params);

/// Tracks a reference with a controller that believes in `believed`. The log ends early when the
/// controller stops itself (ControllerLifecycle, ReferencePilot). Throws alike.
ExperimentLog trackReference(const Model& model, const Model& believed,
                             const TrackingParams& tracking, const ExperimentParams& params);

/// Plays an input design as the nodelet Excitation does; returns are driven by a controller that
/// believes in `believed`. Ends early and throws alike.
ExperimentLog excite(const Model& model, const Model& believed, const ExcitationParams& excitation,
                     const ExperimentParams& params);

}  // namespace ground
