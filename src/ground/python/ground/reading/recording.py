"""Recordings: poses and commands as they were measured."""

import functools
import os
from dataclasses import dataclass, field, fields, replace
from typing import (
    TYPE_CHECKING,
    Any,
    Callable,
    Dict,
    List,
    Mapping,
    Optional,
    Sequence,
    Tuple,
    TypeVar,
    Union,
    cast,
)

import numpy as np

from ground import _core
from ground.reading import units
from ground.reading.commands import CHANNELS
from ground.reading.mapping import LIFT, RANGE
from ground.reading.run_settings import LiveChange, RunFile, Settings
from ground.support import errors
from ground.support.annotations import Array, ArrayLike, Path
from ground.support.docstrings import internal
from ground.support.errors import GroundError
from ground.support.origin import digest
from ground.support.public import public
from ground.support.results import Plotted, with_units

if TYPE_CHECKING:
    import pandas
    import xarray

    from ground import Model
    from ground.poses import repair
    from ground.poses.inertial import InertialSamples
    from ground.poses.low_pass import LowPass
    from ground.reading.sensors import Voltage

_T = TypeVar("_T")

OVERSHOOT = 0.2  # share of its range by which a command may exceed it, and is clipped
JUMP_BACK = 0.5  # largest lateness of a message [s]
SAME_INSTANT = 1e-5  # instants differ by less after rounding [s]
LONG_STEP, IMPOSSIBLE_STEP = 5.0, 100.0  # between poses [s]: longer ones are probably, or surely, wrong
NOT_SECONDS = (
    "are times in seconds? unit: ms under time in a mapping, or a division by 1000, reads milliseconds"
)
POSE = ("x", "y", "psi")
VELOCITY = ("u", "v", "r")
UNITS = {"t": "s", "x": "m", "y": "m", "psi": "rad", "u": "m/s", "v": "m/s", "r": "rad/s"}
UNNAMED = "Unnamed: "  # begins the name that pandas gives a column without one, such as an index
COMMAND = "command."  # before the name of a channel that is also the name of another column
PREDICTED, RESIDUAL, LOW, HIGH = "_predicted", "_residual", "_low", "_high"  # ends of the names of columns


@dataclass(frozen=True, eq=False, repr=False)
class Recording(Plotted):
    """One recorded run, on the clock of its header stamps.

    >>> times = np.arange(0, 5, 0.01)  # [s]
    >>> poses = np.column_stack([0.1 * times, 0 * times, 0 * times])  # it goes north
    >>> commands = np.column_stack([times > 1, times > 1, times > 0])  # left, right, lift
    >>> run = Recording.from_arrays(times, poses, commands, name="north")
    >>> run
    <Recording north: 4.99 s, 500 poses, 500 commands>
    >>> frame = run.to_frame()
    >>> frame.attrs["units"]["u"], round(frame.u.median(), 2)
    ('m/s', 0.1)
    >>> Recording.from_frame(frame, name="again").rename("north 2")
    <Recording north 2: 4.99 s, 500 poses, 500 commands>
    """

    name: str  #: name of the run in tables and files
    pose_times: Array  #: (n,) times of the poses [s], in the order of arrival
    eta: Array  #: (n, 3) measured poses: x, y [m], psi [rad], world_ned
    control_times: Array  #: (m,) times of the commands [s]
    controls: Array  #: (m, c) commands by `channels`, 0..1, reversible ones -1..1
    source: str  #: topics from which the run was read
    clock_offset: float = 0.0  #: added to the poses' stamps to give the commands' clock [s]
    warnings: List[str] = field(default_factory=list)  #: anomalies found while reading, in sentences
    #: (k, 2) [s], a row for each drive that the sender recorded (ground_msgs/Drive): when it began, and
    #: the stamp of the last message about it
    drives: Array = field(default_factory=lambda: np.empty((0, 2)))
    settings: Settings = field(default_factory=Settings)  #: settings of the mocap
    flown_by: Dict[str, str] = field(default_factory=dict)  #: see run_settings.flown_by
    files: Dict[str, RunFile] = field(default_factory=dict)  #: recorded files: `model`, `room`, `truth`
    changes: List[LiveChange] = field(default_factory=list)  #: parameters changed during the run
    path: str = ""  #: path of the bag from which the run was read
    namespace: str = ""  #: namespace of the topics
    channels: Tuple[str, ...] = CHANNELS  #: names of the commands
    lift_channel: str = LIFT  #: channel of the lift fan; `channels` need not contain it
    noise: Optional[Tuple[float, float]] = None  #: given noise of positions [m] and headings [rad]
    frame_rate: Optional[float] = None  #: given frame rate of the mocap's camera [Hz]
    inertial: "Optional[InertialSamples]" = None  #: gyro and accelerometer, if recorded
    payload: _core.Payload = field(default_factory=_core.Payload)  #: load that the craft carried
    voltage: "Optional[Voltage]" = None  #: voltage of the craft's battery, if recorded
    digest: str = ""  #: digest of the files' contents; empty: not read from files
    #: text of the mapping that was drafted to read it; empty: none was drafted
    mapping: str = ""
    #: low-pass of the mocap found from all runs of one call; empty: from this run
    decided: "Tuple[Optional[LowPass], ...]" = ()
    known: Dict[str, Any] = field(default_factory=dict, init=False)  #: results of `once`, no part of the run

    def __getstate__(self) -> Dict[str, Any]:
        return {**{one.name: getattr(self, one.name) for one in fields(self)}, "known": {}}

    @staticmethod
    def from_arrays(
        times: ArrayLike,
        poses: ArrayLike,
        commands: ArrayLike,
        command_times: Optional[ArrayLike] = None,
        channels: Sequence[str] = CHANNELS,
        name: str = "recording",
    ) -> "Recording":
        """Makes a recording from arrays.

        Parameters
        ----------
        times : array (n,)
            Times of the poses [s], in any order.
        poses : array (n, 3)
            x, y [m], psi [rad], world_ned.
        commands : array (m, c)
            Commands by channel, 0 to 1; for thrusters with names other than left and right, -1 to 1. Each
            command is held until the next.
        command_times : array (m,), optional
            Times of the commands on the same clock [s]; by default the times of the poses.
        channels : sequence of str, default ('left', 'right', 'lift')
            Names of the channels as in the model, the lift last.
        name : str, default 'recording'
            Name of the run.

        Raises
        ------
        GroundError
            When an array is wrong; the message names it.
        """
        found = Recording._made(times, poses, commands, command_times, channels, name, channels[-1])
        return replace(found, lift_channel=channels[-1])

    @staticmethod
    def _made(
        times: ArrayLike,
        poses: ArrayLike,
        commands: ArrayLike,
        command_times: Optional[ArrayLike],
        channels: Sequence[str],
        name: str,
        lift: str,
    ) -> "Recording":
        """As from_arrays, with the lift's channel anywhere, or absent."""
        stamps = times if command_times is None else command_times
        rows = _rows("poses", times, poses, POSE)
        sent = _rows("commands", stamps, commands, channels)
        if len(rows) > 1 and np.isfinite(rows).all() and units.in_degrees(rows[:, 0], rows[:, 3]):
            raise GroundError("%s: headings seem to be in degrees: numpy.deg2rad gives radians" % name)
        ranges = {one: RANGE if one in CHANNELS else (-1.0, 1.0) for one in channels if one != lift}
        for one, values in zip(channels, sent[:, 1:].T):
            low, high = ranges.get(one, RANGE)
            if np.min(values, initial=low) < low or np.max(values, initial=high) > high:
                reach = one, values.min(), values.max(), low, high
                raise GroundError("%s: commands of %s range from %g to %g, not %g to %g" % (name, *reach))
        found = checked(name, rows, sent, "arrays", [], channels, ranges)
        for text in found.warnings:
            errors.warn("%s: %s" % (name, text))
        return replace(found, name=name)

    @staticmethod
    def from_frame(
        frame: "pandas.DataFrame", name: str = "recording", channels: Optional[Sequence[str]] = None
    ) -> "Recording":
        """Makes a recording from a table as `to_frame` gives it.

        Parameters
        ----------
        frame : DataFrame
            One row per pose: columns t (seconds, or pandas's times), x, y, psi, and one per channel, by its
            name in the model. Rows with NaN have no command. Velocities are smoothed from the poses.
        name : str, default 'recording'
            Name of the run.
        channels : sequence of str, optional
            Columns of commands. By default left, right and lift, where there are left and right; else all
            columns without poses or velocities.

        Raises
        ------
        GroundError
            When a column is missing, or is not what its name says.

        Warns
        -----
        GroundWarning
            For unused columns beside left and right.
        """
        import pandas

        missing = [column for column in ("t", *POSE, *(channels or ())) if column not in frame]
        if missing:
            raise GroundError("%s: the table has no column %s" % (name, ", ".join(missing)))
        columns = list(channels or (c for c in frame if unit(c) == "1" and not c.startswith(UNNAMED)))
        unused = [c for c in columns if c not in CHANNELS and not channels and {*CHANNELS[:2]} <= {*columns}]
        if unused:
            text = "%s: columns that are not used: %s; channels=[...] names the columns of commands"
            errors.warn(text % (name, ", ".join(unused)))
            columns = [c for c in columns if c in CHANNELS]
        commands, times = frame[columns].to_numpy(float), frame["t"]
        if times.dtype.kind in "mM":  # of numpy, and of pandas with a time zone
            times = (times - times.iloc[0]) / pandas.Timedelta(seconds=1)
        given, times = np.isfinite(commands).any(axis=1), times.to_numpy(float)
        return Recording._made(
            times,
            frame[list(POSE)].to_numpy(float),
            commands[given],
            times[given],
            [c[len(COMMAND) :] if c.startswith(COMMAND) else c for c in columns],
            name,
            LIFT,
        )

    def with_payload(
        self, mass: float, place: Tuple[float, float] = (0.0, 0.0), inertia: float = 0.0
    ) -> "Recording":
        """A copy of the run with a load on the craft.

        Parameters
        ----------
        mass : float
            Mass of the load [kg].
        place : (float, float), default (0.0, 0.0)
            Position of the load's centre of mass, forward and to starboard [m].
        inertia : float, default 0.0
            Inertia of the load about its centre of mass [kg m^2].
        """
        return replace(self, payload=_core.Payload(mass, place, inertia))

    def without(self, *spans: Tuple[float, float]) -> "Recording":
        """A copy of the run without the poses in some spans. No prediction crosses these gaps.

        Parameters
        ----------
        *spans : (float, float)
            Start and end of each span on the run's clock [s].

        Raises
        ------
        GroundError
            When too few poses remain.
        """
        from ground.poses import repair

        zero = max(self.motion.times[0], self.control_times[0])
        times = repair.on_commands_clock(self.pose_times, self.clock_offset) - zero
        keep = np.all([(times < start) | (times > end) for start, end in spans], axis=0) | (not spans)
        if keep.sum() < repair.MIN_POSES:
            raise GroundError("%s: only %d poses remain" % (self.name, keep.sum()))
        return replace(self, pose_times=self.pose_times[keep], eta=self.eta[keep], digest="")

    def within(self, start: float, end: float) -> "Recording":
        """A copy of the run with only the poses in one span."""
        return self.without((-np.inf, start), (end, np.inf))

    def rename(self, name: str) -> "Recording":
        """A copy of the run under another name.

        Parameters
        ----------
        name : str
            New name of the run in tables and files.
        """
        return replace(self, name=name)

    @functools.cached_property
    def identity(self) -> str:
        """Identifies the run whatever its name and path: a digest of the files from which it was read,
        or of the numbers of a recording in memory."""
        if self.digest:
            return self.digest
        arrays = [self.pose_times, self.eta, self.control_times, self.controls]
        if self.inertial is not None:
            arrays += [self.inertial.times, self.inertial.yaw_rate, self.inertial.acceleration]
        if self.voltage is not None:
            arrays += [self.voltage.times, self.voltage.volts]
        return digest(np.asarray(array, float).tobytes() for array in arrays)

    @functools.cached_property
    def motion(self) -> "repair.Motion":
        """The repaired poses, and velocities; a low-pass of the mocap is undone. GroundError when too few
        poses remain."""
        if "motion" in self.known:
            return cast("repair.Motion", self.known["motion"])
        if self.decided:
            return self.as_before(self.decided[0])
        from ground.poses import smoothed

        motion = self.as_before(None)
        found = smoothed.recognised(self.thrust, self.averaged, motion)
        return motion if found is None else self.as_before(found)

    @internal
    def as_before(self, low_pass: "Optional[LowPass]") -> "repair.Motion":
        """The repaired poses, and velocities; as before a low-pass of the mocap, or as they were measured."""
        from ground.poses import repair  # only few uses of a recording need its motion

        given = self.name, self.pose_times, self.eta, self.clock_offset, self.noise, self.frame_rate
        return repair.repair(*given, low_pass)

    @internal
    def with_low_pass(self, low_pass: "Optional[LowPass]") -> "Recording":
        """The same run with the low-pass that was decided for all runs of a call; None: with no low-pass."""
        copies = self.known.setdefault("with_low_pass", {})
        if low_pass not in copies:
            copies[low_pass] = replace(self, decided=(low_pass,))
        return cast(Recording, copies[low_pass])

    @property
    def duration(self) -> float:
        """Time from the first pose to the last one [s]."""
        return float(np.ptp(self.pose_times))

    @property
    def bag(self) -> str:
        """Name of the bag's file; without a bag, the name of the run."""
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

    @internal
    def with_lift_of(self, model: _core.Model) -> "Recording":
        """The same with the model's channel as its lift, where its own names none of the commands."""
        lift = model.channels[-1]
        known = self.lift_channel in self.channels or lift not in self.channels
        return self if known else replace(self, lift_channel=lift)

    @internal
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

    @internal
    def held(self, values: Array, times: Array) -> Array:
        """The values (m, ...) of the commands that hold at some times [s]; 0 before the first command."""
        at = np.searchsorted(self.control_times, times, side="right") - 1
        found = np.asarray(values[np.maximum(at, 0)])
        found[at < 0] = 0
        return found

    @internal
    def averaged(self, values: Array, times: Array, width: float) -> Array:
        """Means of the values (m, k) of the commands over a width [s] about some times [s]; 0 before the
        first command.
        """
        begins = self.control_times
        total = np.vstack([0 * values[:1], np.cumsum(values[:-1] * np.diff(begins)[:, None], axis=0)])
        edges = times + 0.5 * width * np.array([[-1.0], [1.0]])
        after = np.maximum(edges - begins[-1], 0)[..., None] * values[-1]
        at = np.stack([np.interp(edges, begins, column) for column in total.T], axis=-1) + after
        return np.asarray((at[1] - at[0]) / width)

    def to_frame(
        self, raw: bool = False, model: "Union[Model, Path, None]" = None, horizon: Optional[float] = None
    ) -> "pandas.DataFrame":
        """The motion, and the commands in force at its times, as a table.

        Parameters
        ----------
        raw : bool, default False
            Whether to give the measured poses, in order of time and without velocities, instead of the
            repaired motion. Both are on the clock of the commands.
        model : Model or path, optional
            Adds columns NAME_predicted and NAME_residual (measured minus predicted) of `predict`; NaN where
            there is no prediction.

        Returns
        -------
        DataFrame
            Columns t [s] since the first pose, x, y [m], psi [rad], u, v [m/s], r [rad/s], and one for each
            channel (NaN before the first command; command.r where a channel is named r). Units are in
            attrs["units"].

        Raises
        ------
        GroundError
            When poses cannot be repaired.
        """
        import pandas

        from ground.poses import angles, repair

        if raw:
            times = repair.on_commands_clock(self.pose_times, self.clock_offset)
            order = np.argsort(times, kind="stable")
            times, motion, names = times[order], self.eta[order], list(POSE)
        else:
            times, names = self.motion.times, [*POSE, *VELOCITY]
            eta = self.motion.measured
            motion = np.column_stack([eta[:, :2], angles.wrap(eta[:, 2]), self.motion.nu])
        commands = self.held(self.controls, times)
        commands[times < self.control_times[0]] = np.nan
        taken = ["t", *names]
        channels = [COMMAND + name if name in taken else name for name in self.channels]
        rows = np.column_stack([times - times[0], motion, commands])
        frame = pandas.DataFrame(rows, columns=taken + channels)
        if model is not None:
            made = public("predict")(model, self, horizon)
            at = np.searchsorted(times, made.times + made.zero - SAME_INSTANT)
            for i, name in enumerate((*POSE, *VELOCITY)):
                for end, values in ((PREDICTED, made.predicted), (RESIDUAL, made.residuals)):
                    frame[name + end] = np.nan
                    frame.iloc[at, -1] = values[:, i]
        return with_units(frame, {name: unit(name) for name in frame})

    def to_xarray(self, raw: bool = False, model: "Union[Model, Path, None]" = None) -> "xarray.Dataset":
        """The columns of `to_frame` as variables over t, each with its units.

        Parameters
        ----------
        raw : bool, default False
            Whether to give the measured poses.
        model : Model or path, optional
            Adds the model's predictions, as in `to_frame`.

        Raises
        ------
        GroundError
            When xarray is not installed.
        """
        try:
            import xarray
        except ImportError:
            raise GroundError("to_xarray needs the package xarray: pip install xarray")
        frame = self.to_frame(raw, model).set_index("t")
        found = xarray.Dataset.from_dataframe(frame)
        for name, values in found.variables.items():
            values.attrs["units"] = unit(str(name))
        return found

    def __repr__(self) -> str:
        counts = self.duration, len(self.pose_times), len(self.control_times)
        return "<%s %s: %.2f s, %d poses, %d commands>" % (type(self).__name__, self.name, *counts)


def _rows(what: str, times: ArrayLike, values: ArrayLike, names: Sequence[str]) -> Array:
    """Rows of time and values. GroundError when their shapes do not fit."""
    try:
        stamps, rows = np.asarray(times, float), np.asarray(values, float)
    except (TypeError, ValueError) as error:
        raise GroundError("%s: not numbers (%s)" % (what, error))
    if stamps.ndim != 1 or rows.shape != (len(stamps), len(names)):
        shapes = what, rows.shape, stamps.shape, len(names), ", ".join(names)
        raise GroundError(
            "%s have the shape %s and their times %s; they need (n, %d) for %s, and (n,)" % shapes
        )
    return np.column_stack([stamps, rows])


def unit(column: str) -> str:
    """Unit of a column of a table of a run; "1" of a command."""
    for end in (PREDICTED, RESIDUAL, LOW, HIGH):
        if column.endswith(end):
            column = column[: -len(end)]
    return UNITS.get(column, "1")


def once(function: Callable[[Recording], _T]) -> Callable[[Recording], _T]:
    """A function whose result the Recording keeps."""
    name = "%s.%s" % (function.__module__, function.__name__)

    @functools.wraps(function)
    def remembered(recording: Recording) -> _T:
        if name not in recording.known:
            recording.known[name] = function(recording)
        return cast(_T, recording.known[name])

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
                "%s: %d of %d %s are not finite; the first is number %d"
                % (path, bad.sum(), len(rows), what, np.argmax(bad) + 1)
            )
        times = rows[:, 0]
        if times.max() == times.min():
            raise GroundError(
                "%s: all %s have the same stamp, %.3f s: their headers were not filled in; time: "
                "receipt in a mapping uses the recorder's clock" % (path, what, times[0])
            )
        back = np.diff(times)
        if back.min() < -JUMP_BACK:
            raise GroundError(
                "%s: the stamps of the %s jump back by %.2f s at number %d: the clock stepped, or "
                "these are two runs" % (path, what, -back.min(), np.argmin(back) + 2)
            )
    step = float(np.median(np.diff(poses[:, 0])))
    text = "poses come every %.3g s: " % step + NOT_SECONDS
    if step > IMPOSSIBLE_STEP:
        raise GroundError("%s: %s" % (path, text))
    if step > LONG_STEP:
        warnings.append(text)
    every = controls[:, 1:].copy()
    for name, values in zip(channels, controls[:, 1:].T):
        _limit(path, name, every, values, (ranges or {}).get(name, RANGE), warnings)
    units.require_radians(path, poses[:, 0], poses[:, 3])
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


def _limit(
    path: str, name: str, every: Array, values: Array, limits: Tuple[float, float], warnings: List[str]
) -> None:
    """Clips a command to the range of its channel, in place, and counts. every: commands of all channels.
    GroundError when it exceeds the range by more than OVERSHOOT of it."""
    low, high = values.min(), values.max()
    if low >= limits[0] - 1e-9 and high <= limits[1] + 1e-9:
        return
    room = OVERSHOOT * (limits[1] - limits[0])
    if low >= limits[0] - room and high <= limits[1] + room:
        outside = int(((values < limits[0] - 1e-9) | (values > limits[1] + 1e-9)).sum())
        warnings.append(
            "command %s ranges from %.4g to %.4g: %d of %d values are beyond %g to %g and were clipped"
            % (name, low, high, outside, len(values), *limits)
        )
        np.clip(values, *limits, out=values)
        return
    unit = units.command_unit(every[every != 0]) if (every != 0).any() else None
    raise GroundError(
        "%s: commands must be between %g and %g but range from %g to %g%s; name their unit, or the values "
        "off and full, in a mapping (identify info --write-mapping drafts one)%s"
        % (
            path, *limits, every.min(), every.max(),
            ", which looks like %s" % unit if unit in ("percent", "microseconds") else "",
            "; a reversible thruster needs range: [-1, 1], a one-way thruster that is off at -1 needs "
            "off: -1, full: 1" if -1 <= low < 0 else "",
        )
    )  # fmt: skip
