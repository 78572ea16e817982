"""Simulated experiments: the inputs or controller that drive the craft, and the recording.

An input schedule is an array of rows time [s], left, right, lift (0..1), each held until the next.
Everything runs in process, without ROS, and depends only on its arguments.
"""

from dataclasses import dataclass, fields, replace
from typing import Any, Optional, Sequence, Tuple, Union

import numpy as np

from ground import _core
from ground.simulation.simulated_run import SimulatedRun
from ground.support.annotations import Array
from ground.support.errors import GroundError, core_error, core_errors

START = 1000.0  # stamp at which every simulated recording starts [s]
LEAD = 0.5  # time recorded at rest, before the lift is on [s]
WITH_RETURNS = 4  # longest experiment with bursts and returns, in lengths of the inputs
TAIL = 0.5  # time recorded after the thrusters are off [s]
MAX_DURATION = 3600.0  # longest input [s]


@dataclass
class Schedule:
    """Inputs of an open-loop controller: rows of time, inputs of the thrusters, lift, until `end` [s]."""

    rows: Array
    end: float


@dataclass(frozen=True)
class DriveLog:
    """What the core logs of a simulated drive. Rows begin with a time since it began [s]."""

    frames: Array  # (n, 5) captured, delivered [s], pose
    commands: Array  # of the controller
    sent: Array  # commands that have left for the craft; empty in open loop
    truth: Array  # pose, velocity, acceleration, wrench of the disturbance, voltage
    references: Array  # position and its derivatives
    decisions: Array  # stamp of the state, CPU time [s], inputs, the same before saturation
    marks: Sequence[Tuple[float, int, bool, str]]  # number, whether a burst begins, reason
    stages: Sequence[Tuple[float, str, str]]  # state of the controller, reason
    stopped: str  # why it stopped early; empty if it did not
    stopped_at: float


# What drives a craft: inputs, or a controller in the loop.
Drive = Union[Schedule, _core.TrackingParams, _core.ExcitationParams]


def design(
    kind: str, duration: float, model: Optional[_core.Model] = None, **options: Any
) -> _core.InputSignal:
    """A _core.InputSignal: a design by its name (_core.design_table), played for `duration` [s].

    model: the craft, whose thrusters play it (default: left and right). options: members of
    _core.DesignParams. Raises ValueError on bad ones, GroundError when a file cannot be read.
    """
    with core_errors():
        return _core.make_design(design_params(kind, model, **options), duration)


def design_params(kind: str, model: Optional[_core.Model] = None, **options: Any) -> _core.DesignParams:
    """The _core.DesignParams of a design and its options, for the thrusters of a model."""
    params = _core.DesignParams()
    if model is not None:
        params.take_thrusters(model)
    params.kind = kind
    for name, value in options.items():
        setattr(params, name, value)
    return params


def rows(kind: str, duration: float, model: Optional[_core.Model] = None, **options: Any) -> Array:
    """Rows time [s], inputs of the thrusters of a design; arguments as of `design`."""
    return design(kind, duration, model, **options).rows[:, :-1]


def with_lift(rows: Array, duration: float, lift: float = 1.0, lift_time: float = 1.0) -> Schedule:
    """The schedule of an open-loop run from rows of time, inputs of the thrusters: rest, lift alone
    for `lift_time` [s], the rows for `duration` [s], then everything off."""
    lifted = np.column_stack([rows[:, 0] + lift_time, rows[:, 1:], np.full(len(rows), lift)])
    alone = np.zeros(lifted.shape[1])
    alone[-1] = lift
    return as_given(np.vstack([alone, lifted]), lift_time + duration)


def as_given(rows: Array, duration: float) -> Schedule:
    """The schedule of rows of time, inputs, lift that end after `duration` [s]: rest before
    them, everything off after them."""
    end = LEAD + duration
    inputs = np.zeros((1, rows.shape[1] - 1))
    rows = rows + np.column_stack([[LEAD], inputs])
    before, after = np.column_stack([[0.0], inputs]), np.column_stack([[end], inputs])
    return Schedule(np.vstack([before, rows[rows[:, 0] < end], after]), end + TAIL)


def disturbance_in_shares(
    model: _core.Model, share: float = 0.0, time: float = 0.0, trim: float = 0.0
) -> _core.Disturbance:
    """A _core.Disturbance in shares of the craft's full thrust.

    The unit of X and Y is full thrust, 2 k input_max; the unit of N is the moment of one thruster alone,
    k l input_max. share: standard deviation of a wrench whose correlation time is `time` [s]; trim:
    standard deviation, from run to run, of a constant wrench and of the factor on the thrust.
    """
    force = model.value("k") * model.input_max
    unit = np.array([2 * force, 2 * force, force * model.value("l")])
    found = _core.Disturbance()
    found.sigma, found.time = share * unit, np.full(3, float(time))
    found.trim, found.trim_thrust = trim * unit, trim
    return found


def simulate(
    model: _core.Model,
    drive: Drive,
    name: str = "simulated",
    pose: Sequence[float] = (0, 0, 0),
    velocity: Sequence[float] = (0, 0, 0),
    mocap: Optional[_core.MocapParams] = None,
    seed: int = 1,
    believed: Optional[_core.Model] = None,
    disturbance: Optional[_core.Disturbance] = None,
    plant: Optional[_core.Plant] = None,
    battery: Tuple[float, float] = (0.0, 1.0),
) -> SimulatedRun:
    """Runs an experiment and returns its SimulatedRun.

    drive: a Schedule; or _core.TrackingParams for a tracking controller in the loop, or
    _core.ExcitationParams for bursts between returns home: these use the model `believed` (by
    default the one that moves the craft). pose: initial x, y
    [m], psi [rad], world_ned; velocity: initial u, v [m/s], r [rad/s], body. mocap:
    _core.MocapParams. disturbance: _core.Disturbance that acts on the craft, drawn by the seed; the
    model's own acts only if it is given here. plant: the craft, if the model does not move it; it
    has its own pose, velocity and disturbance, and the model gives the thrusters. battery:
    how long it lasts at full power [s], 0 for none, and its charge at the start; the model must say at
    which voltage its k holds. Raises ValueError on
    bad parameters, GroundError when nothing can be recorded or the motion is not finite.
    """
    try:
        log = _log(
            model,
            drive,
            believed or model,
            np.array(pose, float),
            np.array(velocity, float),
            mocap or _core.MocapParams(),
            seed,
            disturbance or _core.Disturbance(),
            plant,
            battery,
        )
    except RuntimeError as error:
        raise core_error(error, name)
    delivered, frames = len(log.frames), len(log.truth)
    if delivered < 2:
        raise GroundError(
            "%s: only %d of %d mocap frames were delivered; there is nothing to record"
            % (name, delivered, frames)
        )
    found = _recorded(log, name, "simulated with %s" % model.name)
    if battery[0] > 0 and plant is None:
        found = found.with_voltage(log.truth[:, 13], seed)
    return replace(found, channels=tuple(model.channels), lift_channel=model.channels[-1])


def _log(model: _core.Model, drive: Drive, believed: _core.Model, *where: Any) -> DriveLog:
    """The core's log; where: pose, velocity, mocap, seed, disturbance, plant, battery."""
    if isinstance(drive, Schedule):
        return logged(_core.play_schedule(model, drive.rows, drive.end, *where))
    if isinstance(drive, _core.ExcitationParams):
        return logged(_core.excite(model, believed, drive, *where))
    return logged(_core.track_reference(model, believed, drive, *where))


def logged(found: Any) -> DriveLog:
    """The DriveLog of a dictionary from the core."""
    return DriveLog(*(found[one.name] for one in fields(DriveLog)))


def _recorded(log: DriveLog, name: str, source: str) -> SimulatedRun:
    """The run on the clock of a recording."""
    frames, truth, commands = log.frames, log.truth, log.commands
    commands[:, 0] += START
    sent, references, decided = log.sent, log.references, log.decisions
    sent[:, 0] += START
    references[:, 0] += START
    wanted = decided[:, (3 + decided.shape[1]) // 2 :]
    decisions = np.column_stack([START + decided[:, :2], decided[:, 2], wanted])
    return SimulatedRun(
        name=name,
        pose_times=START + frames[:, 0],
        eta=frames[:, 2:],
        control_times=(sent if len(sent) else commands)[:, 0],
        controls=(sent if len(sent) else commands)[:, 1:],
        commanded=commands[: len(commands) if len(sent) else 0],
        source=source,
        delivered=START + frames[:, 1],
        truth_times=START + truth[:, 0],
        truth_eta=truth[:, 1:4],
        truth_nu=truth[:, 4:7],
        truth_nu_dot=truth[:, 7:10],
        truth_wrench=truth[:, 10:13],
        references=references,
        decisions=decisions,
        marks=[(START + t, number, burst, why) for t, number, burst, why in log.marks],
        stages=[(START + t, state, reason) for t, state, reason in log.stages],
        stopped=log.stopped,
    )
