#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "ground/control/controllers.h"
#include "ground/control/excitation_pilot.h"
#include "ground/control/reference_pilot.h"
#include "ground/control/reference_trajectory.h"
#include "ground/estimation/motion_filter.h"
#include "ground/safety/controller_lifecycle.h"
#include "ground/safety/ground_link.h"
#include "ground/simulation/hazards.h"
#include "ground/simulation/simulated_lab.h"

// Experiments without ROS, in lockstep: craft, mocap, state estimator, controller and sender, with the
// objects of a flight. The same arguments give the same log, bit by bit.
//
//     TrackingParams tracking;
//     tracking.controller.kind = "ModelPredictive";
//     tracking.room = loadRoom("cfg/room/room_4x4.yaml");
//     const ExperimentLog log = trackReference(truth, believed, tracking, {});
//     if (!log.stopped.empty()) std::cerr << log.stopped << "\n";
//
// Only ExperimentLog::sent reached the craft; `commands` is what the controller asked for. Controlled flights
// may be chaotic: a different compiler or processor rounds differently, and paths part by millimetres.

namespace ground {

/// Craft and mocap of an experiment; its clock starts at 0 s.
struct ExperimentParams {
  RigidState<double> initial;  ///< initial state of the craft
  MocapParams mocap;
  unsigned long seed = 1;  ///< for noise and losses of the mocap, and for the disturbance
  /// Disturbance of the craft; Model::disturbance is not used.
  Disturbance disturbance = {};
  BatteryParams battery = {};  ///< of the craft
  double imu_rate = 0;  ///< samples of a SimulatedImu that the craft sends as they are taken [Hz]; 0: none
  /// The craft, which must outlive the experiment; null for one that moves by the model. With a
  /// given craft, `initial`, `disturbance` and `battery` are not used, and the model gives the number of
  /// thrusters and their largest input. Its clock is the experiment's.
  Plant* plant = nullptr;
  Hazards hazards = {};  ///< its push and braking do not act on a given craft
};

/// A controller and the sender as in the nodelets, with states estimated from the delivered frames. The
/// sender is armed as soon as it can be after the start, and knows the controller's internal model and room.
struct DriveParams {
  DriveParams() { link.recovery_time = 0.5; }  // as in the launch files

  EstimatorParams estimator;
  /// Otherwise states are exact measurements at the frames' captures; the estimator's noise is still stated.
  bool estimate = true;
  LifecycleParams life;
  GroundLinkParams link;     ///< of the sender
  double start = 0.5;        ///< start of the controller; the lift waits for a valid state [s]
  double duration = 20.0;    ///< duration of driving [s]
  double tail = 0.5;         ///< recording time after the end [s]
  std::optional<Room> room;  ///< room of both fences

  std::string validate() const;  ///< error message; empty if all values are valid
};

/// From a measured state, the members of a ReferencePoint, and the time since the reference began [s] to the
/// inputs of all thrusters, as fractions of the largest one.
using ControlLaw = std::function<Eigen::VectorXd(const Vector3<double>& eta, const Vector3<double>& nu,
                                                 const std::vector<Vector2<double>>&, double time)>;

/// A controller that follows a reference.
struct TrackingParams : DriveParams {
  ReferenceParams reference;
  ControllerChoice controller;
  ControlLaw law;  ///< drives instead of `controller`; empty: it does not
  /// Error at which TrackingWatch stops it [m]; 0: defaultMaxError; infinity: never.
  double max_error = 0;
};

/// An input design; with a room, in bursts between returns to its home.
struct ExcitationParams : DriveParams {
  DesignParams design;
  ReturnParams returns;  ///< its room is not used; see DriveParams::room
};

/// The recording of an experiment, and its true motion.
struct ExperimentLog {
  struct Command {
    double time;                  ///< time at which it is issued, sent and received [s]
    Thrusters<double> thrusters;  ///< fractions of the largest input
    double lift;                  ///< 0..1
  };
  struct Truth {
    double time;  ///< [s]
    RigidState<double> state;
    Vector3<double> nu_dot;       ///< body [m/s^2, m/s^2, rad/s^2]
    RigidState<double> measured;  ///< exact measurement of the state
    Vector3<double> wrench;       ///< wrench of the disturbance: X, Y [N], N [N m], body
    double voltage;               ///< of the battery [V]; 0: none
  };
  struct Stage {
    double time;  ///< start [s]
    ControllerLifecycle::State state;
    std::string reason;
  };
  struct Reference {
    double time;  ///< stamp of the state that is compared with it [s]
    ReferencePoint point;
  };

  std::vector<MocapFrame> frames;     ///< in the order of delivery; psi in (-pi, pi]
  std::vector<Command> commands;      ///< what the controller or the schedule asks for
  std::vector<Command> sent;          ///< what has left for the craft; empty if there is no sender
  std::vector<Truth> truth;           ///< at every frame's capture, including lost frames
  std::vector<Reference> references;  ///< only when tracking
  std::vector<ReferencePilot::Decision> decisions;  ///< only when tracking or returning home
  std::vector<Stage> stages;                 ///< states of the controller's life cycle, if there is one
  std::vector<ExcitationPilot::Mark> marks;  ///< bursts and returns of an excitation
  std::string stopped;    ///< why the controller stopped before its end; empty if it did not
  double stopped_at = 0;  ///< time at which it stopped [s]
};

/// Plays commands for `duration` [s], repeated every 20 ms as by the open-loop controller. Inputs
/// of `schedule` are 0..1. There is no sender: each command reaches the craft. Runs in lockstep: the same
/// arguments give the same log, bit by bit. Throws std::invalid_argument on bad parameters,
/// std::runtime_error if the state becomes not finite.
ExperimentLog playSchedule(const Model& model, const InputSequence& schedule, double duration,
                           const ExperimentParams& params);

/// Tracks a reference with a controller whose internal model is `believed`. The log ends early if
/// the controller stops itself (ControllerLifecycle, ReferencePilot), or the sender (SenderGate). Throws like
/// playSchedule.
ExperimentLog trackReference(const Model& model, const Model& believed, const TrackingParams& tracking,
                             const ExperimentParams& params);

/// Plays an input design like the nodelet Excitation; returns are driven by a controller whose
/// internal model is `believed`. Ends early and throws like trackReference.
ExperimentLog excite(const Model& model, const Model& believed, const ExcitationParams& excitation,
                     const ExperimentParams& params);

}  // namespace ground
