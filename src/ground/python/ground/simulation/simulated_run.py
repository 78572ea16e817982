"""A simulated run, and the bag that it makes: like those that launch/record.launch records."""

import functools
import heapq
import operator
import os
import tempfile
from dataclasses import dataclass, field, replace
from itertools import repeat
from typing import Any, Dict, Iterable, Iterator, List, Optional, Tuple

import numpy as np

from ground import _core
from ground.poses.inertial import InertialSamples
from ground.reading import messages
from ground.reading.commands import CHANNELS
from ground.reading.recording import Recording
from ground.reading.run_settings import AXES
from ground.reading.sensors import Voltage
from ground.support import files
from ground.support.annotations import Array, Message, Path, Time
from ground.support.docstrings import internal
from ground.support.origin import digest_of_files
from ground.support.progress import Progress, Work

WRITING = "writing the bag (thousands of messages)"  # stage
TOLD = 1000  # messages that are a unit of it
DRIVE_PERIOD = 0.5  # period of the records of when the drive began [s]
STARTED = ("WAITING", "LIFTING", "RUNNING", "RECOVERING")  # states in which it gives commands
PATH_STEP = 5  # references between points of the path
SENSED = 5e-3  # delay of the craft's sensors [s]
VOLTAGE_NOISE = 1e-3  # of the measured voltage, relative to it
TELLS = "%s (ground_msgs/Telemetry)" % messages.TELEMETRY
MARKER_HEIGHT = 0.04  # height of the markers above the floor [m]
NS = 10**9
Series = Tuple[str, Array, Array, Iterable[Message]]  # topic, record times, stamps, messages
WORLD = "world_ned"


def _rows(*shape: int) -> Any:
    return field(default_factory=lambda: np.empty(shape))


@dataclass(frozen=True, eq=False, repr=False)
class SimulatedRun(Recording):
    """A recording and the simulator's truth about it; all times on the recording's clock.

    >>> run = ground.simulate(model_file, "spin", duration=3)
    >>> run.truth_nu[:, 2].max() > 3  # yaw rate [rad/s]
    True
    """

    delivered: Array = _rows(0)  #: (n,) times at which the poses were delivered [s]
    truth_times: Array = _rows(0)  #: (k,) times of all frames, including lost ones [s]
    truth_eta: Array = _rows(0, 0)  #: (k, 3) true x, y [m], psi [rad], world_ned
    truth_nu: Array = _rows(0, 0)  #: (k, 3) true u, v [m/s], r [rad/s], body
    truth_nu_dot: Array = _rows(0, 0)  #: (k, 3) time derivatives of u, v, r
    truth_wrench: Array = _rows(0, 0)  #: (k, 3) disturbance: X, Y [N], N [N m], body
    #: (h, 2 + n) time, inputs, lift that a controller gave; `controls` is what the sender then sent
    commanded: Array = _rows(0, 0)
    references: Array = _rows(0, 0)  #: (j, 9) time, p, p_dot, p_ddot, p_dddot
    #: (i, 3 + n) time, stamp of the state, processor time [s], wanted inputs (of full scale)
    decisions: Array = _rows(0, 5)
    #: bursts of an excitation: time [s], number, burst or return, reason
    marks: List[Tuple[float, int, bool, str]] = field(default_factory=list)
    #: states of the controller: time [s], state, reason
    stages: List[Tuple[float, str, str]] = field(default_factory=list)
    stopped: str = ""  #: why the controller stopped before its end
    made_with: str = ""  #: parameters of the run, as reading.run_settings.document writes them
    axes: str = AXES  #: world_ned x, y, z in the axes of the mocap
    heading_offset: float = 0.0  #: heading of the rigid body minus the craft's [rad]
    sequence: str = ""  #: how a file of bits was played
    disturbance: Optional[_core.Disturbance] = None  #: the disturbance that acted

    @functools.cached_property
    def identity(self) -> str:
        """Identity as in Recording: the digest of the bag that `save` writes."""
        if self.digest:
            return self.digest
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "run.bag")
            self.save(path)
            return digest_of_files([path])

    @property
    def frames_not_delivered(self) -> int:
        """Number of mocap frames that were lost or late."""
        return len(self.truth_times) - len(self.pose_times)

    @property
    def bursts(self) -> int:
        """Number of bursts of an excitation in a room."""
        return sum(burst for _, _, burst, _ in self.marks)

    @property
    def length(self) -> float:
        """Time from the first frame to the last one, delivered or not [s]."""
        return float(self.truth_times[-1] - self.truth_times[0])

    @property
    def tracking_error(self) -> Optional[float]:
        """Root mean square of the true distance from the reference [m]; None without a reference."""
        if not len(self.references):
            return None
        at = np.searchsorted(self.truth_times, self.references[:, 0])
        off = self.truth_eta[at, :2] - self.references[:, 1:3]
        return float(np.sqrt((off**2).sum(axis=1).mean()))

    @internal
    def sensed(self, seed: int) -> "SimulatedRun":
        """The run with samples of the craft's gyro and accelerometer at each frame of the mocap."""
        rows = _core.sense(self.truth_nu, self.truth_nu_dot, seed)
        return replace(
            self, inertial=InertialSamples(self.truth_times + SENSED, rows[:, 0], rows[:, 1:], TELLS)
        )

    @internal
    def with_voltage(self, volts: Array, seed: int) -> "SimulatedRun":
        """The run with the voltage of the battery (k,) [V], as it was at each frame of the mocap, and as
        the craft measures it.
        """
        noise = VOLTAGE_NOISE * volts.mean() * np.random.default_rng(seed).normal(size=len(volts))
        measured = np.asarray(volts + noise, np.float32).astype(float)
        return replace(self, voltage=Voltage(self.truth_times + SENSED, measured, TELLS))

    def save(self, path: Path, force: bool = False, progress: Progress = None) -> Dict[str, int]:
        """Writes a bag in the form that launch/record.launch records.

        The same run gives the same bytes, except for the computing times of a controller. Poses are
        the rigid body's, in the mocap's axes. Header stamps are times of measurement, record times are
        times of delivery.

        Returns
        -------
        dict
            Number of messages by topic.
        """
        counts: Dict[str, int] = {}
        work = Work.of(progress)
        messages.refuse_other_format(os.fspath(path))
        with files.new_file(os.fspath(path), force) as temporary:
            with work.stage(WRITING), messages.bag_writer(temporary) as bag:
                series = _series(self)
                work.more(sum(len(s[1]) for s in series) // TOLD + 1)  # the last one: the index
                rows = [zip(times, repeat(topic), stamps, found) for topic, times, stamps, found in series]
                in_order = heapq.merge(*rows, key=operator.itemgetter(0))
                for number, (received, topic, stamp, message) in enumerate(in_order, 1):
                    if number % TOLD == 0:
                        work.step()
                    message.header.seq = counts.get(topic, 0)
                    message.header.stamp = _time(stamp)
                    bag.write(topic, message, int(round(received * NS)))
                    counts[topic] = counts.get(topic, 0) + 1
        return counts


def _time(seconds: float) -> Time:
    return messages.time(int(round(seconds * NS)))


def _new(kind: str, frame: str = "", **fields: Any) -> Message:
    message = messages.new(kind, **fields)
    if frame:
        message.header.frame_id = frame
    return message


def _series(run: SimulatedRun) -> List[Series]:
    """All series of a run."""
    start = run.truth_times[:1]
    made = start if run.made_with else start[:0]
    drives, marks = _drives(run), np.array([mark[0] for mark in run.marks], float)
    decided, followed = run.decisions[:, 0], _reference_times(run)
    settings = [_new("ground_msgs/MocapSettings", axes=run.axes, heading_offset=run.heading_offset)]
    began = (_new("ground_msgs/Drive", began=_time(at)) for at in drives[:, 0])
    truths = (
        _new("ground_msgs/State", WORLD, eta=eta, nu=nu, nu_dot=nu_dot, valid=True)
        for eta, nu, nu_dot in zip(run.truth_eta, run.truth_nu, run.truth_nu_dot)
    )
    bursts = (_new("ground_msgs/Burst", number=n, burst=burst, reason=why) for _, n, burst, why in run.marks)
    decisions = (
        _new("ground_msgs/Decision", messages.CONTROLLER, state=_time(row[1]), computing=row[2])
        for row in run.decisions
    )
    sensed = [] if run.inertial is None and run.voltage is None else [_sensed(run)]
    return [
        (messages.SETTINGS, start, start, settings),
        (messages.RUN_SETTINGS, made, made, [_new("ground_msgs/RunSettings", yaml=run.made_with)]),
        (messages.TRUTH, run.truth_times, run.truth_times, truths),
        (messages.POSE, run.delivered, run.pose_times, _poses(run)),
        (messages.REFERENCE, followed, run.references[:, 0], _references(run)),
        (messages.REFERENCE_PATH, followed[:1], run.references[:1, 0], _reference_path(run)),
        (messages.DRIVE, drives[:, 1], drives[:, 1], began),
        (messages.BURSTS, marks, marks, bursts),
        (messages.WANTED, decided, decided, _wanted(run)),
        (messages.DECISION, decided, decided, decisions),
        *_controls(run),
        *sensed,
    ]


def _sensed(run: SimulatedRun) -> Series:
    """The series of telemetry."""
    times, count = run.truth_times + SENSED, len(run.truth_times)
    rows, volts = np.zeros((count, 3), np.int32), np.zeros(count, np.float32)
    if run.inertial is not None:
        rows[:] = np.column_stack([run.inertial.yaw_rate, run.inertial.acceleration])
    if run.voltage is not None:
        volts[:] = run.voltage.volts
    found = (
        _new(
            "ground_msgs/Telemetry",
            gyro=np.array([0, 0, row[0]], np.int32),
            acc=np.array([*row[1:], 0], np.int32),
            mag=np.zeros(3, np.int32),
            voltage=voltage,
        )
        for row, voltage in zip(rows, volts.tolist())
    )
    return messages.TELEMETRY, times, times, found


def _poses(run: SimulatedRun) -> Iterator[Message]:
    mapping = _core.AxisMapping(run.axes, run.heading_offset)
    for eta in run.eta:
        message = _new("geometry_msgs/PoseStamped", "mocap")
        position, orientation = mapping.to_mocap(eta, MARKER_HEIGHT)
        p, q = message.pose.position, message.pose.orientation
        p.x, p.y, p.z = position
        q.x, q.y, q.z, q.w = orientation
        yield message


def _controls(run: SimulatedRun) -> List[Series]:
    """The series of commands, and of what the sender sent of them if there was one."""
    sent = run.control_times, run.control_times, (_inputs(run, row[:-1], row[-1]) for row in run.controls)
    if not len(run.commanded):
        return [(messages.CONTROLS, *sent)]
    given = run.commanded[:, 0]
    return [(messages.CONTROLS, given, given, _commands(run)), (messages.SENT, *sent)]


def _commands(run: SimulatedRun) -> Iterator[Message]:
    started = [name in STARTED for _, name, _ in run.stages]
    at = np.searchsorted([stage[0] for stage in run.stages], run.commanded[:, 0], side="right") - 1
    for stage, row in zip(at, run.commanded):
        message = _inputs(run, row[1:-1], row[-1])
        if stage >= 0 and started[stage]:
            message.header.frame_id = messages.CONTROLLER
        yield message


def _inputs(run: SimulatedRun, thrusters: Array, lift: float) -> Message:
    """Message with inputs; of a craft that lists its thrusters with the names of its channels."""
    if run.channels == CHANNELS:
        return _new("ground_msgs/Controls", left=thrusters[0], right=thrusters[1], lift=lift)
    return _new("ground_msgs/Controls", lift=lift, thrusters=thrusters, channels=list(run.channels))


def _wanted(run: SimulatedRun) -> Iterator[Message]:
    """The inputs that a controller wanted before they were limited."""
    at = np.searchsorted(run.control_times, run.decisions[:, 0])
    for row, command in zip(run.decisions, run.controls[np.minimum(at, len(run.controls) - 1)]):
        message = _inputs(run, row[3:], command[-1])
        message.header.frame_id = messages.CONTROLLER
        yield message


def _drives(run: SimulatedRun) -> Array:
    """Rows of when the newest drive began, and when the sender reports it [s]."""
    starts = _core.drive_starts(run.control_times, run.controls[:, -1])
    ends = starts[1:] + [run.control_times[-1]]
    rows = [(a, t) for a, b in zip(starts, ends) for t in np.arange(a, b, DRIVE_PERIOD)]
    return np.array(rows, float).reshape(-1, 2)


def _reference_times(run: SimulatedRun) -> Array:
    """When references are published: on delivery of the state, with the command that it causes."""
    delivered = dict(zip(run.pose_times, run.delivered))
    return np.array([delivered[stamp] for stamp in run.references[:, 0]], float)


def _references(run: SimulatedRun) -> Iterator[Message]:
    for row in run.references:
        p, *derivatives = row[1:9].reshape(4, 2)
        fields = dict(zip(("p_dot", "p_ddot", "p_dddot"), derivatives))
        yield _new("ground_msgs/Reference", WORLD, p=p, **fields)


def _reference_path(run: SimulatedRun) -> Iterator[Message]:
    """The whole reference as a path, as controllers publish it when they start."""
    if not len(run.references):
        return
    message = _new("nav_msgs/Path", WORLD)
    for row in run.references[::PATH_STEP]:
        pose = _new("geometry_msgs/PoseStamped", WORLD)
        pose.pose.position.x, pose.pose.position.y = row[1:3]
        pose.pose.orientation.w = 1
        message.poses.append(pose)
    yield message
