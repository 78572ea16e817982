"""Recordings: poses and commands as they were measured."""

import functools
import os
from dataclasses import dataclass, field, replace
from typing import (
    TYPE_CHECKING,
    Callable,
    Dict,
    List,
    Mapping,
    Optional,
    Sequence,
    Tuple,
    TypeVar,
    cast,
)

import numpy as np

from ground import _core
from ground.recordings import repair, units
from ground.recordings.commands import CHANNELS
from ground.recordings.mapping import LIFT, RANGE
from ground.recordings.run_settings import LiveChange, RunFile, Settings
from ground.support.annotations import Array, ArrayLike
from ground.support.errors import GroundError
from ground.support.origin import digest

if TYPE_CHECKING:
    import pandas

_T = TypeVar("_T")

JUMP_BACK = 0.5  # largest lateness of a message [s]


@dataclass(frozen=True, eq=False, repr=False)
class Recording:
    """One run as it was recorded, on the clock of its header stamps."""

    name: str
    pose_times: Array  #: (n,) [s], in the order of arrival
    eta: Array  #: (n, 3) x, y [m], psi [rad], world_ned
    control_times: Array  #: (m,) [s]
    controls: Array  #: (m, c) commands by `channels`, 0..1, reversible ones -1..1
    source: str  #: topics that it was read from
    clock_offset: float = 0.0  #: to add to the stamps of the poses for the clock of the commands [s]
    warnings: List[str] = field(default_factory=list)
    # (k, 2) [s], a row for each drive that the sender recorded (ground_msgs/Drive): when it began, and
    # the stamp of the last message about it
    drives: Array = field(default_factory=lambda: np.empty((0, 2)))
    settings: Settings = field(default_factory=Settings)  #: settings of the mocap
    flown_by: Dict[str, str] = field(default_factory=dict)  #: run_settings.flown_by
    files: Dict[str, RunFile] = field(default_factory=dict)  #: by `model` and `room`, if recorded
    changes: List[LiveChange] = field(default_factory=list)  #: changes during the run
    path: str = ""  #: path of the bag that it was read from
    channels: Tuple[str, ...] = CHANNELS  #: names of the commands
    lift_channel: str = LIFT  #: the one of the lift fan; there may be none of this name
    digest: str = ""  #: of the content of the files that it was read from; empty: none

    @functools.cached_property
    def identity(self) -> str:
        """What tells the run from others, whatever its name and place: a digest of the files that it was
        read from, or of the numbers of a recording in memory."""
        if self.digest:
            return self.digest
        arrays = (self.pose_times, self.eta, self.control_times, self.controls)
        return digest(np.asarray(array, float).tobytes() for array in arrays)

    @functools.cached_property
    def motion(self) -> repair.Motion:
        """The repaired poses, and velocities. GroundError when too little of them is left."""
        return repair.repair(self.name, self.pose_times, self.eta, self.clock_offset)

    @property
    def duration(self) -> float:
        """From the first pose to the last one [s]."""
        return float(np.ptp(self.pose_times))

    @property
    def bag(self) -> str:
        """Name of its bag's file, or its own name."""
        return os.path.basename(self.path) or self.name

    @property
    def thrusters(self) -> Tuple[str, ...]:
        """Names of the channels that are thrusters."""
        return tuple(name for name in self.channels if name != self.lift_channel)

    @property
    def thrust(self) -> Array:
        """Commands of the thrusters (m, n)."""
        return self.commands_of(self.thrusters)

    @property
    def lift(self) -> Array:
        """Command of the lift fan (m,); zeros where there is no such channel."""
        if self.lift_channel not in self.channels:
            return np.zeros(len(self.control_times))
        return np.asarray(self.controls[:, self.channels.index(self.lift_channel)])

    def with_lift_of(self, model: _core.Model) -> "Recording":
        """The same with the model's channel as its lift, where its own names none of the commands."""
        lift = model.channels[-1]
        known = self.lift_channel in self.channels or lift not in self.channels
        return self if known else replace(self, lift_channel=lift)

    def commands_of(self, names: Sequence[str]) -> Array:
        """Commands of some channels (m, len(names)). GroundError for a channel that is missing."""
        missing = [name for name in names if name not in self.channels]
        if missing:
            raise GroundError(
                "%s: no command is named %s, which the model expects; the commands are %s: name the "
                "channels in a mapping as the model names its thrusters"
                % (self.name, " or ".join(missing), ", ".join(self.channels))
            )
        return np.asarray(self.controls[:, [self.channels.index(name) for name in names]])

    def held(self, values: Array, times: Array) -> Array:
        """The values (m, ...) of the commands that hold at some times [s]; 0 before the first command."""
        at = np.searchsorted(self.control_times, times, side="right") - 1
        found = np.asarray(values[np.maximum(at, 0)])
        found[at < 0] = 0
        return found

    def to_frame(self, raw: bool = False) -> "pandas.DataFrame":
        """The repaired motion and the commands held at its times: columns t [s] since the first pose, x,
        y [m], psi [rad], u, v [m/s], r [rad/s], and a column for each channel (NaN before the first
        command; named command.r where a channel is named r). raw: the poses as they were measured, in
        order of time and without velocities. Both are on the clock of the commands. GroundError when
        poses cannot be repaired."""
        import pandas

        if raw:
            times = repair.on_commands_clock(self.pose_times, self.clock_offset)
            order = np.argsort(times, kind="stable")
            times, motion, names = times[order], self.eta[order], ["x", "y", "psi"]
        else:
            times, names = self.motion.times, ["x", "y", "psi", "u", "v", "r"]
            eta = np.where(self.motion.spikes[:, None], self.motion.eta, self.motion.measured)
            motion = np.column_stack([eta[:, :2], repair.wrap(eta[:, 2]), self.motion.nu])
        commands = self.held(self.controls, times)
        commands[times < self.control_times[0]] = np.nan
        taken = ["t", *names]
        channels = ["command." + name if name in taken else name for name in self.channels]
        rows = np.column_stack([times - times[0], motion, commands])
        return pandas.DataFrame(rows, columns=taken + channels)

    def __repr__(self) -> str:
        counts = self.duration, len(self.pose_times), len(self.control_times)
        return "<%s %s: %.2f s, %d poses, %d commands>" % (type(self).__name__, self.name, *counts)


def once(function: Callable[[Recording], _T]) -> Callable[[Recording], _T]:
    """A function whose result the Recording remembers."""
    name = "_%s.%s" % (function.__module__, function.__name__)

    @functools.wraps(function)
    def remembered(recording: Recording) -> _T:
        if name not in vars(recording):
            vars(recording)[name] = function(recording)
        return cast(_T, vars(recording)[name])

    return remembered


def checked(
    path: str,
    poses: ArrayLike,
    controls: ArrayLike,
    source: str,
    warnings: List[str],
    channels: Sequence[str] = CHANNELS,
    ranges: Optional[Mapping[str, Tuple[float, float]]] = None,
) -> Recording:
    """A Recording of rows of stamp, x, y, psi and of stamp and a command for each channel.

    ranges: (least, most) by channel, where they are not 0..1. GroundError names `path` and what is
    wrong with the rows.
    """
    poses, controls = np.array(poses, float), np.array(controls, float)
    for what, rows in (("poses", poses), ("controls", controls)):
        if len(rows) < 2:
            raise GroundError("%s: only %d %s" % (path, len(rows), what))
        bad = ~np.isfinite(rows).all(axis=1)
        if bad.any():
            raise GroundError(
                "%s: %d of %d %s are not finite, the first is number %d"
                % (path, bad.sum(), len(rows), what, np.argmax(bad) + 1)
            )
        times = rows[:, 0]
        if times.max() == times.min():
            raise GroundError(
                "%s: all %s have the same stamp, %.3f s: their headers were not filled in; time: "
                "receipt in a mapping takes the recorder's clock" % (path, what, times[0])
            )
        back = np.diff(times)
        if back.min() < -JUMP_BACK:
            raise GroundError(
                "%s: the stamps of the %s jump back by %.2f s at number %d: the clock was set, or "
                "these are two runs" % (path, what, -back.min(), np.argmin(back) + 2)
            )
    for name, values in zip(channels, controls[:, 1:].T):
        _check_range(path, controls[:, 1:], values, (ranges or {}).get(name, RANGE))
    if units.in_degrees(poses[:, 0], poses[:, 3]):
        raise GroundError(
            "%s: headings reach %.0f and change by up to %.1f from pose to pose: they seem to be in "
            "degrees, but radians are needed; heading: {field: NAME, unit: deg} under poses in a "
            "mapping turns them into radians"
            % (path, np.abs(poses[:, 3]).max(), np.abs(np.diff(poses[:, 3])).max())
        )
    controls = controls[np.argsort(controls[:, 0], kind="stable")]
    return Recording(
        name=os.path.splitext(os.path.basename(path))[0],
        pose_times=poses[:, 0],
        eta=poses[:, 1:],
        control_times=controls[:, 0],
        controls=controls[:, 1:],
        source=source,
        warnings=warnings,
        channels=tuple(channels),
    )


def _check_range(path: str, every: Array, values: Array, limits: Tuple[float, float]) -> None:
    """GroundError when a command is outside the range of its channel. every: commands of all channels."""
    low = values.min()
    if low >= limits[0] - 1e-9 and values.max() <= limits[1] + 1e-9:
        return
    unit = units.command_unit(every[every != 0]) if (every != 0).any() else None
    raise GroundError(
        "%s: controls reach from %g to %g, but they are normalised to %g..%g;%s give their channels a unit, "
        "or off and full, in a mapping (identify info --write-mapping drafts one)%s"
        % (
            path, every.min(), every.max(), *limits,
            " they seem to be in %s:" % unit if unit in ("percent", "microseconds") else "",
            "; a thruster that can be reversed has range: [-1, 1], one that cannot and is off at -1 has "
            "off: -1, full: 1" if -1 <= low < 0 else "",
        )
    )  # fmt: skip
