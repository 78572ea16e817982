"""Drafts of mapping files: what a file has, and what of it is probably what, with the evidence."""

import re
from dataclasses import dataclass
from typing import Dict, Iterator, List, Mapping, Sequence, Tuple

import numpy as np

from ground.recordings import containers, poses, units
from ground.recordings.containers import RECEIVED, STAMP, TABLE, Columns, Container
from ground.recordings.mapping import LENGTHS, SCHEMA, TIMES
from ground.support.annotations import Array
from ground.support.errors import GroundError

MAX_ROWS = 20000  # messages of a topic to look at
MAX_LEVELS = 40  # levels of a command that switches
LIKELY = re.compile(r"cmd|command|control|thrust|motor|pwm|input|actuator|demand", re.I)
HEADING = re.compile(r"(^|[._ ])(heading|yaw|psi|theta)\b", re.I)
TIME = re.compile(r"time|stamp|secs|^t\b", re.I)
COUNTER = re.compile(r"(^|\.)(seq|secs|nsecs)$")
DEGREES = re.compile(r"deg|°", re.I)
NOT_COMMANDS = set(poses.KINDS) - {"geometry_msgs/Pose", "geometry_msgs/PointStamped"}


@dataclass
class Seen:
    """The numbers of a topic, or of one body on it, and what they probably are."""

    topic: str
    kind: str
    count: int
    values: Dict[str, Array]  # by path; each (n,)
    times: Array  # (n,) by the header, of receipt, or of a column [s]
    body: str = ""  # that the poses are of
    clock: str = ""  # the key `time` of a table
    clock_fields: Tuple[str, ...] = ()
    position: Tuple[str, ...] = ()  # empty where it has no pose
    rotation: Tuple[str, ...] = ()  # quaternion, or heading

    @property
    def name(self) -> str:
        """Topic and body."""
        return self.topic + (", body %s" % self.body if self.body else "")

    def table(self, paths: Sequence[str]) -> Array:
        """Some of the numbers (n, k)."""
        return np.column_stack([self.values[path] for path in paths])


def draft(source: Container, in_folder: bool, types: Sequence[str] = ()) -> str:
    """The text of a mapping for a file; in_folder: its tables are files of a folder; types: what the mapping
    names for types that the file does not define."""
    every: List[Seen] = []
    unread: List[str] = []
    for topic, entry in sorted(source.topics.items()):
        try:
            columns = source.table(topic) if entry.count else {}
            every += _seen(topic, entry.kind, entry.count, columns) if columns else []
            unread += [] if columns else ["#   %s (%s), without messages" % (topic, entry.kind)]
        except GroundError as error:
            why = str(error).replace(source.path + ": ", "")
            unread.append("#   %s (%s), %d messages, not read: %s" % (topic, entry.kind, entry.count, why))
    with_poses = sorted((c for c in every if c.position), key=_pose_order)
    scores = {id(c): _command_score(c) for c in every if c.kind not in NOT_COMMANDS}
    scored = sorted((c for c in every if scores.get(id(c), 0) > 0), key=lambda c: -scores[id(c)])
    chosen = with_poses[0] if with_poses else None
    other = [c for c in scored if c is not chosen or c.kind == TABLE]
    if chosen is None and not other:
        why = "".join("\n  " + line.lstrip("# ") for line in unread)
        raise GroundError(
            "%s: nothing in it has poses or numbers that could be commands%s" % (source.path, why)
        )
    lines = ["# Drafted from %s. Look through it: what is guessed says why." % source.path]
    lines += ["schema: %s" % SCHEMA, "", "# In the file:"]
    lines += ["#   %s (%s), %d messages%s" % (c.name, c.kind, c.count, _rate(c)) for c in every] + unread
    lines += ["types: [%s]" % ", ".join(map(_quoted, types))] if types else []
    lines += ["poses:", *("  " + line for line in _pose_lines(with_poses, in_folder))]
    lines += ["commands:", *("  " + line for line in _command_lines(other, in_folder))]
    return "\n".join(lines) + "\n"


def _seen(topic: str, kind: str, count: int, columns: Columns) -> Iterator[Seen]:
    """What a topic has, for each body."""
    known = poses.KINDS.get(kind)
    columns = {name: column[:MAX_ROWS] for name, column in columns.items()}
    rows = len(next(iter(columns.values())))
    names = columns[known.body] if known and known.body in columns else np.full(rows, "", object)
    stamps = columns.get(STAMP, columns.get(RECEIVED))
    times = np.arange(rows, dtype=float) if stamps is None else containers.seconds(stamps)
    numbers = {name: columns[name].astype(float) for name in containers.numbers(columns)}
    for body in sorted(set(names)):
        of_body = names == body
        values = {name: column[of_body] for name, column in numbers.items()}
        seen = Seen(topic, kind, count, values, times[of_body], str(body))
        if kind == TABLE:
            _find_clock(seen)
        _find_pose(seen)
        yield seen


def _find_clock(seen: Seen) -> None:
    """Which columns of a table are the time."""
    for seconds in (name for name in seen.values if re.search(r"(^|\.)secs$", name)):
        rest = seconds[:-4] + "nsecs"
        if rest in seen.values:
            seen.clock = "{field: %s, unit: s, nanoseconds: %s}" % (_quoted(seconds), _quoted(rest))
            seen.clock_fields = (seconds, rest)
            seen.times = seen.values[seconds] + 1e-9 * seen.values[rest]
            return
    rising = [
        name
        for name, values in seen.values.items()
        if np.isfinite(values).all() and (np.diff(values) >= 0).mean() > 0.95 and np.ptp(values) > 0
    ]
    likely = [name for name in rising if TIME.search(name)] or rising
    if likely:
        values = seen.values[likely[0]]
        unit = _time_unit(likely[0], values)
        seen.clock = "{field: %s, unit: %s}" % (_quoted(likely[0]), unit)
        seen.clock_fields = (likely[0],)
        seen.times = values * (TIMES[unit] * 1e-9)


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


def _find_pose(seen: Seen) -> None:
    """Where a topic has a pose: by its type, or by the names of fields; a quaternion has length 1."""
    for position, rotation in _pose_fields(seen):
        if set(position + rotation) <= set(seen.values):
            length = (seen.table(rotation) ** 2).sum(axis=1)
            if len(rotation) == 1 or np.median(np.abs(length - 1)) < 0.1:
                seen.position, seen.rotation = position, rotation
                return


def _pose_fields(seen: Seen) -> Iterator[Tuple[Tuple[str, ...], Tuple[str, ...]]]:
    known = poses.KINDS.get(seen.kind)
    if known:
        yield known.fields()
        return
    for name in seen.values:
        if re.search(r"(^|\.)w$", name):
            stem = name[:-1]
            before = re.sub(r"(orientation|rotation)\.$", "", stem)
            for middle in ("position.", "translation.", ""):
                if before + middle != stem:
                    yield tuple(before + middle + a for a in "xyz"), tuple(stem + a for a in "xyzw")
    headings = [name for name in seen.values if HEADING.search(name)]
    planar = tuple(n for n in seen.values if re.search(r"(^|\.)[xy]( |$|\[|_)", n))
    if headings and len(planar) == 2:
        yield planar, (headings[0],)


def _axes(position: Array, quaternion: Array) -> str:
    """The axes that fit poses (n, 3) and (n, 4) best, and why."""
    axes, share = units.likely_axes(np.column_stack([position, quaternion]))
    vertical = "xyz".index(axes[-1])
    sign = "positive: up" if np.median(position[:, vertical]) >= 0 else "negative: down"
    why = "%s moves least, %.0f%% of the poses are upright by it, and it is mostly %s"
    return 'axes: "%s"  # ' % axes + why % (axes[-1], 100 * share, sign)


def _pose_order(seen: Seen) -> Tuple[int, float]:
    """The likely types first, and of them the one that moves most."""
    order = poses.rank(seen.topic.rsplit("/", 1)[-1], seen.kind)
    moved = np.linalg.norm(np.ptp(seen.table(seen.position), axis=0))
    return (5 if order is None else order), -float(moved)


def _rate(seen: Seen) -> str:
    length = float(np.ptp(seen.times)) if len(seen.times) > 1 else 0.0
    return " at %.1f Hz" % ((len(seen.times) - 1) / length) if length > 0 else ""


def _place(candidates: Sequence[Seen], in_folder: bool) -> Iterator[str]:
    seen = candidates[0]
    if seen.kind != TABLE:
        yield "topic: %s" % _quoted(seen.topic)
        yield "type: %s" % seen.kind
        if seen.body:
            yield "body: %s" % _quoted(seen.body)
    elif in_folder:
        yield "file: %s" % _quoted(seen.topic)
    if len(candidates) > 1:
        yield "# others: %s" % ", ".join("%s (%s)" % (c.name, c.kind) for c in candidates[1:])


def _pose_lines(candidates: Sequence[Seen], in_folder: bool) -> Iterator[str]:
    if not candidates:
        yield "topic: ''  # nothing in the file seems to have poses"
        return
    chosen, known = candidates[0], candidates[0].kind in poses.KINDS
    yield from _place(candidates, in_folder)
    position, rotation = chosen.table(chosen.position), chosen.table(chosen.rotation)
    likely, fast = units.length_units(chosen.times, position)
    unit = likely[0] if likely else "m"
    names = "" if known else "fields: [%s], " % ", ".join(map(_quoted, chosen.position))
    ranges = ", ".join(
        "%s %.4g to %.4g" % (path.rsplit(".", 1)[-1], low, high)
        for path, low, high in zip(chosen.position, position.min(axis=0), position.max(axis=0))
    )
    yield "position: {%sunit: %s}  # %s, %.3g a second" % (names, unit, ranges, fast)
    if rotation.shape[1] == 4:
        if not known:
            yield "orientation: [%s]" % ", ".join(map(_quoted, chosen.rotation))
        yield _axes(LENGTHS[unit] * position, rotation)
    elif not known:
        (heading,) = chosen.rotation
        degrees = bool(DEGREES.search(heading)) or units.in_degrees(chosen.times, rotation[:, 0])
        unit = "deg" if degrees else "rad"
        ends = rotation.min(), rotation.max()
        yield "heading: {field: %s, unit: %s, sign: 1}  # %.4g to %.4g" % (_quoted(heading), unit, *ends)
        yield '# axes: "x, -y, -z"  # where z points up and headings are counter-clockwise'
    if chosen.clock:
        yield "time: %s" % chosen.clock


def _inputs(seen: Seen) -> Dict[str, Array]:
    """Numbers that could be commands: of few levels, or that do not change but are not 0."""
    taken = {*seen.clock_fields, *seen.position, *seen.rotation}
    return {
        path: values
        for path, values in seen.values.items()
        if path not in taken
        and not COUNTER.search(path)
        and np.isfinite(values).all()
        and (units.command_unit(values) or LIKELY.search(seen.topic + path))
        and np.any(values != 0)
    }


def _command_score(seen: Seen) -> float:
    """How likely a topic has the commands."""
    found = _inputs(seen)
    if not found:
        return 0.0
    switching = [
        len(np.unique(v)) <= MAX_LEVELS or units.command_unit(v) != "normalised" for v in found.values()
    ]
    likely = bool(LIKELY.search(seen.topic)) or any(LIKELY.search(path) for path in found)
    changes = any(np.any(np.diff(v) != 0) for v in found.values())
    return 2.0 * likely + changes + float(np.mean(switching))


def _command_lines(candidates: Sequence[Seen], in_folder: bool) -> Iterator[str]:
    if not candidates:
        yield "topic: ''  # nothing in the file seems to have commands"
        return
    yield from _place(candidates, in_folder)
    if candidates[0].clock:
        yield "time: %s" % candidates[0].clock
    elif candidates[0].kind != TABLE:
        yield "# time: receipt  # in place of the header's stamp, which a type without one has not"
    found = _inputs(candidates[0])
    yield "channels:  # name each as the model names its thruster, or lift"
    names = _names(found)
    for path, values in found.items():
        unit = units.command_unit(values)
        low, high = float(values.min()), float(values.max())
        meaning = "unit: %s" % unit if unit else "off: %g, full: %g" % (low, high)
        meaning += ", range: [-1, 1]" * (unit != "microseconds" and low < 0)
        changes = int((np.diff(values) != 0).sum())
        line = "  %s: {field: %s, %s}  # %g to %g, %d changes"
        yield line % (names[path], _quoted(path), meaning, low, high, changes)


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
