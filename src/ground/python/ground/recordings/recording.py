"""Recordings: poses and commands as they were measured, and reading them from a bag."""

import functools
import os
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Dict, List, Mapping, Optional, Sequence, Tuple

import numpy as np

from ground import _core
from ground.annotations import Array, ArrayLike, Flags, Time
from ground.errors import GroundError
from ground.recordings import commands, digest, flown, live_changes, messages, plausibility, poses, units
from ground.recordings import settings as measured
from ground.recordings.bag_reader import BagReader, Topic
from ground.recordings.commands import CHANNELS
from ground.recordings.mapping import DEFAULT, LIFT, RANGE, FieldMapping
from ground.recordings.messages import MessageSource

if TYPE_CHECKING:
    import pandas

    from ground.recordings import quality

JUMP_BACK = 0.5  # largest lateness of a message [s]
FARTHEST = 1e4  # largest plausible coordinate of a pose [m]
MANY_LOST = 0.1  # share of lost poses from which their axes are checked


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
    settings: measured.Settings = field(default_factory=measured.default)  #: settings of the mocap
    flown_by: Dict[str, str] = field(default_factory=dict)  #: flown.read
    files: Dict[str, flown.RunFile] = field(
        default_factory=dict
    )  #: flown.RunFile by `model` and `room`, if recorded
    changes: List[live_changes.LiveChange] = field(default_factory=list)  #: changes during the run
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
        return digest.of_parts(np.asarray(array, float).tobytes() for array in arrays)

    @functools.cached_property
    def repaired(self) -> "quality.Run":
        """The recording with its motion repaired, and its usable spans."""
        from ground.recordings import quality  # slow to load

        return quality.Run(self)

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

    def to_frame(self, raw: bool = False) -> "pandas.DataFrame":
        """The repaired motion and the commands held at its times: columns t [s] since the first pose, x,
        y [m], psi [rad], u, v [m/s], r [rad/s], and a column for each channel (NaN before the first
        command; named command.r where a channel is named r). raw: the poses as they were measured, in
        order of time and without velocities. Both are on the clock of the commands. GroundError when
        poses cannot be repaired."""
        import pandas

        from ground.recordings import repair  # slow to load

        if raw:
            times = repair.pose_times(self)
            order = np.argsort(times, kind="stable")
            times, motion, names = times[order], self.eta[order], ["x", "y", "psi"]
        else:
            found = self.repaired.motion
            times, names = found.times, ["x", "y", "psi", "u", "v", "r"]
            eta = np.where(found.spikes[:, None], found.eta, found.measured)
            motion = np.column_stack([eta[:, :2], repair.wrap(eta[:, 2]), found.nu])
        at = np.searchsorted(self.control_times, times, side="right") - 1
        commands = np.where((at < 0)[:, None], np.nan, self.controls[np.maximum(at, 0)])
        taken = ["t", *names]
        channels = ["command." + name if name in taken else name for name in self.channels]
        rows = np.column_stack([times - times[0], motion, commands])
        return pandas.DataFrame(rows, columns=taken + channels)

    def __repr__(self) -> str:
        return "<%s %s: %.2f s, %d poses, %d commands>" % (
            type(self).__name__,
            self.name,
            self.duration,
            len(self.pose_times),
            len(self.control_times),
        )


def read_bag(path: str, mapping: FieldMapping = DEFAULT) -> Recording:
    """The recording in a bag of ROS 1, whatever of it is there. Raises GroundError."""
    if os.path.isdir(path):
        raise GroundError("%s: a folder, not a bag; name the bags in it" % path)
    if not os.path.isfile(path):
        raise GroundError("%s: no such file" % path)
    with BagReader(path) as bag:
        return read_source(bag, path, mapping)


def read_source(source: MessageSource, path: str, mapping: FieldMapping) -> Recording:
    """The recording in an open MessageSource, by what the mapping says.

    Where the mapping names no topic, poses come from a mocap PoseStamped where there is one, else
    from a PointStamped `pose` or `eta` (x, y, psi), from ground_msgs/State, or from the only topic of
    another type with poses; commands from the topic `controls`. Mocap poses become world_ned by the
    mapping's axes and heading_offset where given, else by the settings that were recorded with the
    run; planar ones take the heading offset; states are corrected already. Raises GroundError.
    """
    warnings = source.warnings
    info = source.get_type_and_topic_info().topics
    topics = _topics(info, path, mapping)
    changes = live_changes.changes_of(source)
    flown_by, run_files = flown.read(path, source)
    kind = info[topics["poses"]].msg_type
    taken = poses.takes(kind, mapping.poses)
    settings = measured.settings_of(source, path, taken, mapping, warnings)
    reader = poses.PoseReader(
        "%s: %s" % (path, topics["poses"]), kind, mapping.poses, settings
    )
    command_reader = commands.CommandReader(
        "%s: %s" % (path, topics["controls"]), info[topics["controls"]].msg_type, mapping.commands
    )
    rows = _rows(source, info, topics, reader, command_reader)
    reader.finish()
    if rows.lost:
        warnings.append(_lost(path, rows, reader))
    rows.mend_stamps(warnings)
    controls = command_reader.normalised(rows.rows["controls"])
    channels = command_reader.channels
    disorder = int((np.diff(controls[:, 0]) < 0).sum())
    if disorder:
        warnings.append("stamps of the commands are out of order and were sorted (%d)" % disorder)
    names = [channel.name for channel in channels]
    sent = rows.rows["controls"]
    warnings += plausibility.lone_commands(sent[:, 0], sent[:, 1:], names)
    found = checked(
        path,
        _shifted(rows.rows["poses"], mapping),
        controls,
        ", ".join("%s (%s)" % (topic, info[topic].msg_type) for topic in topics.values()),
        warnings,
        names,
        {channel.name: channel.range for channel in channels},
    )
    mends_clock = bool(mapping.clock_offset or mapping.clock_drift)
    # Sorted by the last message on each, so that the next message overrules a damaged one.
    ordered = sorted(rows.drives.items(), key=lambda row: float(row[1]))
    return replace(
        found,
        path=str(path),
        lift_channel=command_reader.lift,
        drives=np.array(ordered, float).reshape(-1, 2),
        settings=settings,
        changes=changes,
        flown_by=flown_by,
        files=run_files,
        # One recorder received both: if their delays differ by much, their stamps have two clocks.
        clock_offset=0.0 if mends_clock else rows.delay("poses") - rows.delay("controls"),
    )


def _shifted(rows: Array, mapping: FieldMapping) -> Array:
    """Rows that begin with a stamp, on the clock that a mapping says."""
    shifted, stamps = rows.copy(), rows[:, 0]
    shifted[:, 0] = stamps + mapping.clock_offset + mapping.clock_drift * (stamps - stamps[:1])
    return shifted


@dataclass
class _Rows:
    """Poses and controls in a bag."""

    rows: Dict[str, Array]  # stamps and values
    receipts: Dict[str, Array]  # when each row was received [s]
    drives: Dict[float, float]  # when each drive began -> stamp of the last message about it [s]
    lost: int  # poses that are invalid

    def mend_stamps(self, warnings: List[str]) -> None:
        """Replaces single stamps that contradict the recorder's clock."""
        for what, rows in self.rows.items():
            stamps, count, error = plausibility.mend_stamps(rows[:, 0], self.receipts[what])
            if count:
                rows[:, 0] = stamps
                warnings.append(
                    "the bag may be damaged: single stamps of the %s contradict the recorder's "
                    "clock and were replaced (%d, by up to %.3f s)" % (what, count, error)
                )

    def delay(self, what: str) -> float:
        """Median time from stamp to receipt [s]."""
        return float(np.median(self.receipts[what] - self.rows[what][:, 0]))


def _rows(
    source: MessageSource,
    info: Mapping[str, Topic],
    topics: Mapping[str, str],
    poses_of: poses.PoseReader,
    commands_of: commands.CommandReader,
) -> _Rows:
    drives: Dict[float, float] = {}
    for message in messages.of_type(source, "ground_msgs/Drive"):
        drives[message.began.to_sec()] = message.header.stamp.to_sec()
    found = _at_once(source, topics, poses_of, commands_of)
    if found is None:
        found = _one_by_one(source, topics, poses_of, commands_of)
    rows, receipts, valid = found
    kept = valid & ~(np.abs(rows["poses"][:, 1:3]) > FARTHEST).any(axis=1)
    rows["poses"], receipts["poses"] = rows["poses"][kept], receipts["poses"][kept]
    return _Rows(rows, receipts, drives, int((~kept).sum()))


# Rows of stamp and values of poses and controls, times of receipt [s], and which poses are valid
_Found = Tuple[Dict[str, Array], Dict[str, Array], Flags]


def _at_once(
    source: MessageSource,
    topics: Mapping[str, str],
    poses_of: poses.PoseReader,
    commands_of: commands.CommandReader,
) -> Optional[_Found]:
    """Poses and controls of messages that can be decoded together; None where they cannot."""
    batches = {what: source.batch(topic) for what, topic in topics.items()}
    sent, measured_in = batches["controls"], batches["poses"]
    if sent is None or measured_in is None:
        return None
    controls, found = commands_of.of_batch(sent), poses_of.of_batch(measured_in)
    if controls is None or found is None:
        return None
    receipts = {"poses": measured_in.received, "controls": sent.received}
    return {"poses": found[0], "controls": controls}, receipts, found[1]


def _one_by_one(
    source: MessageSource,
    topics: Mapping[str, str],
    poses_of: poses.PoseReader,
    commands_of: commands.CommandReader,
) -> _Found:
    """Poses and controls of any messages."""
    rows: Dict[str, List[Tuple[float, ...]]] = {what: [] for what in topics}
    receipts: Dict[str, List[float]] = {what: [] for what in topics}
    valid: List[bool] = []

    def take(what: str, stamp: Time, received: Optional[Time], values: Tuple[float, ...]) -> None:
        seconds = stamp.to_sec()
        rows[what].append((seconds,) + values)
        receipts[what].append(seconds if received is None else received.to_sec())

    for topic, message, received in source.read_messages(topics.values()):
        if topic == topics["controls"]:
            stamp, values = commands_of(message, received)
            take("controls", stamp, received, values)
        if topic == topics["poses"]:
            for stamp, pose in poses_of(message, received):
                take("poses", stamp, received, (np.nan,) * 3 if pose is None else pose)
                valid.append(pose is not None)
    widths = {"poses": 4, "controls": 1 + len(commands_of.channels)}
    found = {what: np.array(rows[what], float).reshape(-1, widths[what]) for what in topics}
    received_at = {what: np.array(receipts[what], float) for what in topics}
    return found, received_at, np.array(valid, bool)


def _lost(path: str, rows: _Rows, reader: poses.PoseReader) -> str:
    """How many poses are lost, with the axes that would keep them where these are why. GroundError when
    none is left."""
    count = rows.lost + len(rows.rows["poses"])
    fit = units.fitting_axes(reader.raw) if reader.raw else None
    if fit is None or rows.lost < MANY_LOST * count or "axes" not in reader.settings.taken:
        return "%d poses are invalid and were left out" % rows.lost
    axes, share = fit
    text = "%.0f%% of the poses do not fit the axes '%s' and were left out: --axes \"%s\" fits %.0f%%" % (
        100 * rows.lost / count,
        reader.settings.changes[0].axes,
        axes,
        100 * share,
    )
    if len(rows.rows["poses"]) < 2:
        raise GroundError("%s: %s" % (path, text))
    return text


def read_settings(path: str) -> measured.Settings:
    """The settings.Settings by which the mocap's poses in a bag become world_ned. Raises
    GroundError."""
    if not os.path.isfile(path):
        raise GroundError("%s: no such file" % path)
    with BagReader(path) as bag:
        return measured.settings_of(bag, path, ("axes", "heading_offset"), DEFAULT)


def read_files(path: str) -> Dict[str, flown.RunFile]:
    """flown.RunFile by `model` and `room` that were recorded with the run. Raises GroundError."""
    if not os.path.isfile(path):
        raise GroundError("%s: no such file" % path)
    with BagReader(path) as bag:
        return flown.read(path, bag)[1]


def _topics(info: Mapping[str, Topic], path: str, mapping: FieldMapping) -> Dict[str, str]:
    """Topics of the poses and of the controls."""
    for topic, option in (
        (mapping.poses.topic, "--pose-topic"),
        (mapping.commands.topic, "--command-topic"),
    ):
        if topic and (topic not in info or not info[topic].message_count):
            raise GroundError(
                "%s: no messages on %s, which %s names; it has %s"
                % (path, topic, mapping.file or option, _there(info))
            )
    ranked = _control_ranks(info)
    chosen = {}
    if mapping.poses.topic:
        chosen["poses"] = poses.named(info, mapping.poses, path)
    else:
        others = [mapping.commands.topic] if mapping.commands.topic else list(ranked)
        chosen["poses"] = _best(path, "poses", poses.candidates(info, mapping.poses, others), info)
    if mapping.commands.topic:
        chosen["controls"] = commands.named(info, mapping.commands, path)
    else:
        chosen["controls"] = _best(path, "controls", ranked, info)
    return chosen


def _control_ranks(info: Mapping[str, Topic]) -> Dict[str, int]:
    ranks = {t: commands.rank(t.rsplit("/", 1)[-1], e.msg_type) for t, e in info.items()}
    return {t: r for t, r in ranks.items() if r is not None and info[t].message_count > 0}


def _there(info: Mapping[str, Topic]) -> str:
    named = ("%s (%s)" % (t, e.msg_type) for t, e in sorted(info.items()))
    return ", ".join(named) or "no messages at all"


OPTIONS = {"poses": "--pose-topic", "controls": "--command-topic"}


def _best(path: str, what: str, ranks: Mapping[str, int], info: Mapping[str, Topic]) -> str:
    """The topic of the lowest rank. GroundError when there is none or several have it."""
    if not ranks:
        raise GroundError(
            "%s: no %s in this bag; it has %s; %s names another topic, and identify info "
            "--write-mapping drafts a mapping for other fields and units"
            % (path, what, _there(info), OPTIONS[what])
        )
    same = sorted(topic for topic, rank in ranks.items() if rank == min(ranks.values()))
    if len(same) > 1:
        raise GroundError(
            "%s: several topics could be the %s: %s; choose one by %s"
            % (path, what, ", ".join(same), OPTIONS[what])
        )
    return same[0]


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
    _check_ranges(path, controls[:, 1:], channels, ranges or {})
    if units.in_degrees(poses[:, 0], poses[:, 3]):
        raise GroundError(
            "%s: headings reach %.0f and change by up to %.1f from pose to pose: they seem to be in "
            "degrees, but radians are needed; heading: {field: NAME, unit: deg} under poses in a "
            "mapping turns them into radians"
            % (path, np.abs(poses[:, 3]).max(), np.abs(np.diff(poses[:, 3])).max())
        )
    order = np.argsort(controls[:, 0], kind="stable")
    controls = controls[order]
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


def _check_ranges(
    path: str,
    controls: Array,
    channels: Sequence[str],
    ranges: Mapping[str, Tuple[float, float]],
) -> None:
    """GroundError when a command is outside the range of its channel."""
    for name, values in zip(channels, controls.T):
        least, most = ranges.get(name, RANGE)
        low, high = values.min(), values.max()
        if low < least - 1e-9 or high > most + 1e-9:
            unit = units.command_unit(controls[controls != 0]) if (controls != 0).any() else None
            seem = " they seem to be in %s:" % unit if unit in ("percent", "microseconds") else ""
            raise GroundError(
                "%s: controls reach from %g to %g, but they are normalised to %g..%g;%s give their "
                "channels a unit, or off and full, in a mapping (identify info --write-mapping drafts "
                "one)%s"
                % (
                    path,
                    controls.min(),
                    controls.max(),
                    least,
                    most,
                    seem,
                    "; a thruster that can be reversed has range: [-1, 1], one that cannot and is off at "
                    "-1 has off: -1, full: 1" if -1 <= low < 0 else "",
                )
            )
