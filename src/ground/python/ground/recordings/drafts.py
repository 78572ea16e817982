"""Drafts of mapping files: what a file has, and what of it is probably what, with the evidence."""

import re
from dataclasses import dataclass
from typing import Dict, Iterator, List, Mapping, Optional, Sequence, Tuple

import numpy as np

from ground.annotations import Array
from ground.errors import GroundError
from ground.recordings import fields, poses, units
from ground.recordings.mapping import LENGTHS, SCHEMA, TIMES
from ground.recordings.bag_reader import Topic
from ground.recordings.messages import MessageSource

MAX_MESSAGES = 20000  # messages of a topic to look at
MAX_LEVELS = 40  # levels of a command that switches
LIKELY = re.compile(r"cmd|command|control|thrust|motor|pwm|input|actuator|demand", re.I)
HEADING = re.compile(r"(^|[._ ])(heading|yaw|psi|theta)\b", re.I)
TIME = re.compile(r"time|stamp|secs|^t\b", re.I)
COUNTER = re.compile(r"(^|\.)(seq|secs|nsecs)$")
DEGREES = re.compile(r"deg|°", re.I)
NOT_COMMANDS = set(poses.KINDS) - {"geometry_msgs/Pose", "geometry_msgs/PointStamped"}


@dataclass
class Columns:
    """The numbers of a topic."""

    topic: str
    kind: str
    count: int
    times: Array  # (n,) by the header, of receipt, or of a column [s]
    values: Dict[str, Array]  # by path; each (n,)
    body: str = ""  # that the poses are of
    clock: str = ""  # the key `time` of a table
    clock_fields: Tuple[str, ...] = ()

    @property
    def is_table(self) -> bool:
        """Whether its fields are columns."""
        return self.kind == poses.TABLE


@dataclass
class PoseGuess:
    """Where a topic has its pose."""

    position: Tuple[str, ...]
    rotation: Tuple[str, ...]  # quaternion, or heading


def columns_of(source: MessageSource) -> List[Columns]:
    """The numbers of all topics of a source, those of several bodies apart."""
    found = []
    for topic, entry in sorted(source.get_type_and_topic_info().topics.items()):
        kind = poses.KINDS.get(entry.msg_type, poses.Kind(""))
        rows: Dict[str, List[Tuple[float, Dict[str, float]]]] = {}
        for count, (_, message, received) in enumerate(source.read_messages([topic])):
            if count >= MAX_MESSAGES:
                break
            for item in fields.getter([kind.each])(message)[0] if kind.each else [message]:
                body = str(getattr(item, kind.body, "")) if kind.body else ""
                header = getattr(item, "header", None)
                stamp = header.stamp if header is not None else received
                time = float(count) if stamp is None else stamp.to_sec()
                rows.setdefault(body, []).append((time, dict(fields.numbers(item))))
        for body, of_body in sorted(rows.items()):
            found.append(_columns(topic, entry, body, of_body))
    return found


def _columns(
    topic: str, entry: Topic, body: str, rows: Sequence[Tuple[float, Mapping[str, float]]]
) -> Columns:
    names = [name for name in rows[0][1] if all(name in row for _, row in rows)]
    values = {name: np.array([row[name] for _, row in rows]) for name in names}
    times = np.array([time for time, _ in rows])
    columns = Columns(topic, entry.msg_type, entry.message_count, times, values, body)
    if columns.is_table:
        _find_clock(columns)
    return columns


def _find_clock(columns: Columns) -> None:
    """Which columns of a table are the time."""
    rising = [
        name
        for name, values in columns.values.items()
        if np.isfinite(values).all() and (np.diff(values) >= 0).mean() > 0.95 and np.ptp(values) > 0
    ]
    pairs = [(n, n[:-4] + "nsecs") for n in columns.values if re.search(r"(^|\.)secs$", n)]
    for seconds, nanoseconds in pairs:
        if nanoseconds in columns.values:
            columns.clock = "{field: %s, unit: s, nanoseconds: %s}" % (
                _quoted(seconds),
                _quoted(nanoseconds),
            )
            columns.clock_fields = (seconds, nanoseconds)
            columns.times = columns.values[seconds] + 1e-9 * columns.values[nanoseconds]
            return
    likely = [name for name in rising if TIME.search(name)] or rising
    if likely:
        values = columns.values[likely[0]]
        unit = _time_unit(likely[0], values)
        columns.clock = "{field: %s, unit: %s}" % (_quoted(likely[0]), unit)
        columns.clock_fields = (likely[0],)
        columns.times = values * (TIMES[unit] * 1e-9)


def _time_unit(name: str, values: Array) -> str:
    """By the name of a column, its size if it is a time since 1970, or its steps."""
    said = re.search(r"[\[(_ ](s|ms|us|ns)[\])]?$", name)
    if said:
        return said.group(1)
    for unit, since in (("ns", 1e17), ("us", 1e14), ("ms", 1e11), ("s", 1e8)):
        if values[0] > since:
            return unit
    step = float(np.median(np.diff(values)))
    return "s" if step < 1 else "ms" if step < 1000 else "us" if step < 1e6 else "ns"


def _quoted(name: str) -> str:
    plain = re.fullmatch(r"[A-Za-z_][\w.]*", name) and name not in ("off", "on", "yes", "no", "y", "n")
    return name if plain else '"%s"' % name.replace('"', '\\"')


def pose_guess(columns: Columns) -> Optional[PoseGuess]:
    """Where a topic has a pose; None where it seems to have none."""
    kind = poses.KINDS.get(columns.kind)
    if kind:
        position, rotation = kind.fields()
        return PoseGuess(position, rotation)
    for name in columns.values:
        stem = name[:-1] if re.search(r"(^|\.)w$", name) else None
        quaternion = tuple("%s%s" % (stem, axis) for axis in "xyzw")
        if stem is None or not all(path in columns.values for path in quaternion):
            continue
        before = re.sub(r"(orientation|rotation)\.$", "", stem)
        for middle in ("position.", "translation.", ""):
            position = tuple(before + middle + axis for axis in "xyz")
            if set(position) <= set(columns.values) and position != quaternion[:3]:
                return PoseGuess(position, quaternion)
    headings = [name for name in columns.values if HEADING.search(name)]
    planar = tuple(n for n in columns.values if re.search(r"(^|\.)[xy]( |$|\[|_)", n))
    return PoseGuess(planar, (headings[0],)) if headings and len(planar) == 2 else None


def is_pose(columns: Columns) -> bool:
    """Whether the pose that a topic seems to have is one: a quaternion of length 1."""
    guess = pose_guess(columns)
    if guess is None:
        return False
    if len(guess.rotation) == 1:
        return True
    length = sum(columns.values[path] ** 2 for path in guess.rotation)
    return bool(np.median(np.abs(length - 1)) < 0.1)


def axes_guess(position: Array, quaternion: Array) -> Tuple[str, float, str]:
    """The axes that fit poses (n, 3) and (n, 4) best, the share of poses that they fit, and why."""
    rows = np.column_stack([position, quaternion])
    shares = [units.upright(rows, pair[0]) for pair in units.VERTICAL]
    spread = np.ptp(position, axis=0)
    best = int(np.lexsort([spread, -np.array(shares)])[0])
    up = float(np.median(position[:, best])) >= 0
    why = "%s moves least, %.0f%% of the poses are upright by it, and it is mostly %s" % (
        "xyz"[best],
        100 * shares[best],
        "positive: up" if up else "negative: down",
    )
    return units.VERTICAL[best][0 if up else 1], shares[best], why


def draft(source: MessageSource, name: str, in_folder: bool) -> str:
    """The text of a mapping for a file; in_folder: its tables are files of a folder."""
    every = columns_of(source)
    with_poses = sorted((c for c in every if is_pose(c)), key=_pose_order)
    with_commands = sorted(
        (c for c in every if c.kind not in NOT_COMMANDS), key=lambda c: -_command_score(c)
    )
    with_commands = [c for c in with_commands if _command_score(c) > 0]
    chosen = with_poses[0] if with_poses else None
    other = [c for c in with_commands if c is not chosen or c.is_table]
    if chosen is None and not other:
        raise GroundError("%s: nothing in it has poses or numbers that could be commands" % name)
    lines = ["# Drafted from %s. Look through it: what is guessed says why." % name]
    lines += ["schema: %s" % SCHEMA, "", "# In the file:"]
    lines += ["#   %s (%s), %d messages%s" % (_name(c), c.kind, c.count, _rate(c)) for c in every]
    lines += ["poses:"]
    lines += ["  " + line for line in _pose_lines(chosen, with_poses, in_folder)]
    lines += ["commands:"]
    lines += ["  " + line for line in _command_lines(other, chosen, in_folder)]
    return "\n".join(lines) + "\n"


def _pose_order(columns: Columns) -> Tuple[int, float]:
    """The likely types first, and of them the one that moves most."""
    order = poses.rank(columns.topic.rsplit("/", 1)[-1], columns.kind)
    guess = pose_guess(columns)
    moved = [float(np.ptp(columns.values[p])) for p in guess.position] if guess else [0.0]
    return (5 if order is None else order), -float(np.linalg.norm(moved))


def _name(columns: Columns) -> str:
    return columns.topic + (", body %s" % columns.body if columns.body else "")


def _rate(columns: Columns) -> str:
    length = float(np.ptp(columns.times)) if len(columns.times) > 1 else 0.0
    return " at %.1f Hz" % ((len(columns.times) - 1) / length) if length > 0 else ""


def _place(columns: Columns, in_folder: bool) -> Iterator[str]:
    if not columns.is_table:
        yield "topic: %s" % _quoted(columns.topic)
        yield "type: %s" % columns.kind
        if columns.body:
            yield "body: %s" % _quoted(columns.body)
    elif in_folder:
        yield "file: %s" % _quoted(columns.topic)


def _others(columns: Sequence[Columns]) -> Iterator[str]:
    if len(columns) > 1:
        yield "# others: %s" % ", ".join("%s (%s)" % (_name(c), c.kind) for c in columns[1:])


def _pose_lines(
    chosen: Optional[Columns], candidates: Sequence[Columns], in_folder: bool
) -> Iterator[str]:
    guess = pose_guess(chosen) if chosen else None
    if chosen is None or guess is None:
        yield "topic: ''  # nothing in the file seems to have poses"
        return
    yield from _place(chosen, in_folder)
    yield from _others(candidates)
    position = np.column_stack([chosen.values[path] for path in guess.position])
    likely, fast = units.length_units(chosen.times, position)
    unit = likely[0] if likely else None
    known = chosen.kind in poses.KINDS
    names = "" if known else "fields: [%s], " % ", ".join(map(_quoted, guess.position))
    ranges = ", ".join(
        "%s %.4g to %.4g" % (path.rsplit(".", 1)[-1], low, high)
        for path, low, high in zip(guess.position, position.min(axis=0), position.max(axis=0))
    )
    yield "position: {%sunit: %s}  # %s, %.3g a second" % (names, unit or "m", ranges, fast)
    rotation = [chosen.values[path] for path in guess.rotation]
    if len(rotation) == 4:
        if not known:
            yield "orientation: [%s]" % ", ".join(map(_quoted, guess.rotation))
        scale = LENGTHS[unit] if unit else 1.0
        axes, _, why = axes_guess(scale * position, np.column_stack(rotation))
        yield 'axes: "%s"  # %s' % (axes, why)
    elif not known:
        (heading,) = guess.rotation
        degrees = bool(DEGREES.search(heading)) or units.in_degrees(chosen.times, rotation[0])
        yield "heading: {field: %s, unit: %s, sign: 1}  # %.4g to %.4g" % (
            _quoted(heading),
            "deg" if degrees else "rad",
            rotation[0].min(),
            rotation[0].max(),
        )
        yield "# axes: \"x, -y, -z\"  # where z points up and headings are counter-clockwise"
    if chosen.clock:
        yield "time: %s" % chosen.clock


def _inputs(columns: Columns, taken: Sequence[str] = ()) -> Dict[str, Array]:
    """Numbers that could be commands: of few levels, or that do not change but are not 0."""
    found = {}
    for path, values in columns.values.items():
        if path in columns.clock_fields or path in taken or not np.isfinite(values).all():
            continue
        if COUNTER.search(path):
            continue
        if units.command_unit(values) is None and not LIKELY.search(columns.topic + path):
            continue
        if np.any(values != 0):
            found[path] = values
    return found


def _taken(columns: Columns) -> Tuple[str, ...]:
    guess = pose_guess(columns) if is_pose(columns) else None
    return guess.position + guess.rotation if guess else ()


def _command_score(columns: Columns) -> float:
    """How likely a topic has the commands."""
    found = _inputs(columns, _taken(columns))
    if not found:
        return 0.0
    switching = [
        len(np.unique(v)) <= MAX_LEVELS or units.command_unit(v) != "normalised"
        for v in found.values()
    ]
    likely = bool(LIKELY.search(columns.topic)) or any(LIKELY.search(path) for path in found)
    changes = any(np.any(np.diff(v) != 0) for v in found.values())
    return 2.0 * likely + changes + float(np.mean(switching))


def _command_lines(
    candidates: Sequence[Columns], chosen: Optional[Columns], in_folder: bool
) -> Iterator[str]:
    if not candidates:
        yield "topic: ''  # nothing in the file seems to have commands"
        return
    columns = candidates[0]
    yield from _place(columns, in_folder)
    yield from _others(candidates)
    if columns.clock:
        yield "time: %s" % columns.clock
    elif not columns.is_table:
        yield "# time: receipt  # in place of the header's stamp, which a type without one has not"
    found = _inputs(columns, _taken(columns))
    yield "channels:  # name each as the model names its thruster, or lift"
    names = _names(found)
    for path, values in found.items():
        yield "  " + _channel(names[path], path, values)


def _names(found: Mapping[str, Array]) -> Dict[str, str]:
    """Names of channels: those of the fields; of three, the one that changes least is the lift."""
    plain = {path: re.sub(r"\W+", "_", path).strip("_") for path in found}
    last = {path: path.rsplit(".", 1)[-1] for path in found}
    if set(last.values()) >= {"left", "right"}:
        return last
    changes = {path: int((np.diff(v) != 0).sum()) for path, v in found.items()}
    if len(found) > 1:
        lift = min(found, key=lambda path: changes[path])
        rest = [path for path in found if path != lift]
        plain[lift] = "lift"
        if len(rest) == 2:
            plain.update(zip(rest, ("left", "right")))
    return plain


def _channel(name: str, path: str, values: Array) -> str:
    unit = units.command_unit(values)
    low, high = float(values.min()), float(values.max())
    meaning = "unit: %s" % unit if unit else "off: %g, full: %g" % (low, high)
    if unit != "microseconds" and low < 0:
        meaning += ", range: [-1, 1]"
    changes = int((np.diff(values) != 0).sum())
    return "%s: {field: %s, %s}  # %g to %g, %d changes" % (
        name,
        _quoted(path),
        meaning,
        low,
        high,
        changes,
    )
