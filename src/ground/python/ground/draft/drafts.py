"""Drafts of mapping files: what a file has, and what of it is probably what, with the evidence."""

import math
from dataclasses import replace
from typing import Any, Dict, FrozenSet, Iterator, List, Sequence, Set, Tuple

import numpy as np
import yaml

from ground.draft import clocks, levels, several, sightings
from ground.draft.several import Seen
from ground.draft.undecided import CLEAR, MARK
from ground.reading import containers, pose_columns, rows_apart, units, words
from ground.reading.containers import RECEIVED, STAMP, TABLE, Columns, Container, Topic
from ground.reading.mapping import ANGLES, FURTHER_LENGTHS, LENGTHS, SCHEMA
from ground.support import bounded_yaml
from ground.support.annotations import Array
from ground.support.errors import GroundError

MAX_ROWS = 20000  # messages of a topic to look at
MIN_UPRIGHT = 0.99  # share of the poses that are upright by the right axes
NORTH = 0.5  # mean angle between the heading and the course within which a compass's north is 0 [rad]
ALIKE = 0.15  # difference of the likelihoods of two names of headings that are as likely
RATES = ("rad/s", "deg/s")
MAX_CHANNELS = 9  # that a mapping may have
UPWARD = {"z": "x, -y, -z", "y": "x, z, -y", "x": "y, -z, -x"}  # axes by the one that points up
NOT_COMMANDS = set(pose_columns.KINDS) - {"geometry_msgs/Pose", "geometry_msgs/PointStamped"}


def draft(source: Container, in_folder: bool, types: Sequence[str] = ()) -> str:
    """The text of a mapping for a file; in_folder: its tables are files of a folder; types: what the mapping
    names for types that the file does not define."""
    read, unread = _read(source)
    many = len(read) > 1 and all(e.kind == TABLE for _, e, _ in read)
    shared = set.intersection(*(set(columns) for _, _, columns in read)) if many else set()
    every = [seen for topic, e, columns in read for seen in _seen(topic, e.kind, e.count, columns, shared)]
    with_poses = sorted((c for c in every if c.poses), key=_pose_order)
    scores = {id(c): levels.score(c.topic, _free(c)) for c in every if c.kind not in NOT_COMMANDS}
    scored = sorted((c for c in every if scores.get(id(c), 0) > 0), key=lambda c: -scores[id(c)])
    chosen = with_poses[0] if with_poses else None
    other = [c for c in scored if c is not chosen or c.kind == TABLE]
    if in_folder and chosen is not None:
        flown = chosen.times
        other.sort(key=lambda c: not several.covers(c.times, flown, 0.5))
    runs = _runs(with_poses, scored) if in_folder else []
    if runs:
        every_run = {path: np.concatenate([run.whole[path] for run in runs]) for path in runs[0].whole}
        with_poses, other, in_folder = runs[:1], [replace(runs[0], whole=every_run)], False
    if chosen is None and not other and not any(seen.values for seen in every):
        why = "".join("\n  " + line.lstrip("# ") for line in unread)
        raise GroundError(
            "%s: it contains neither poses nor numbers that could be commands%s" % (source.path, why)
        )
    lines = ["# Drafted from %s. Check it: each guess gives its reason." % source.path]
    lines += ["schema: %s" % SCHEMA, "", "# In the file:"]
    lines += ["#   %s (%s), %d messages%s" % (c.name, c.kind, c.count, _rate(c)) for c in every] + unread
    lines += ["#   %s" % warning for warning in source.warnings]
    if not with_poses or not other:
        lines += ["#     %s" % line for c in every for line in _ranges(c)]
    lines += ["# Each of %d tables has poses and commands and is read as a run." % len(runs)] if runs else []
    lines += ["types: [%s]" % ", ".join(map(clocks.quoted, types))] if types else []
    if other and (runs or other[0] is chosen):
        # tables like a run are other runs, and no further thrusters of it
        every = [seen for seen in every if not seen.poses and not runs]
    commanded = ["  " + line for line in _command_lines(other, every, in_folder)]
    is_sided = {"left", "right"} <= {line.split(":")[0].strip() for line in commanded}
    lines += ["poses:", *("  " + line for line in _pose_lines(with_poses, in_folder, is_sided))]
    lines += ["commands:", *commanded]
    text = "\n".join(lines) + "\n"
    return text + _unused(text, with_poses[:1] + other[:1])


def _unused(text: str, chosen: Sequence[Seen]) -> str:
    """A line on the numbers in the tables chosen that a mapping does not use; empty without any."""
    try:
        used = set(_texts(yaml.load(text, bounded_yaml.LOADER)))
    except yaml.YAMLError:  # a name has characters that YAML does not take: the draft has to be completed
        return ""
    names = dict.fromkeys(name for seen in chosen if seen.kind == TABLE for name in seen.whole)
    left = [name for name in names if name not in used]
    return "# Columns of numbers that it does not use: %s\n" % ", ".join(left) if left else ""


def _texts(content: Any) -> Iterator[str]:
    """The texts in a document but for units, with and without a minus before them."""
    if isinstance(content, str):
        yield from (content, content.lstrip("-"))
    elif isinstance(content, (list, dict)):
        inner = content if isinstance(content, list) else [content[key] for key in content if key != "unit"]
        for one in inner:
            yield from _texts(one)


def _runs(with_poses: Sequence[Seen], scored: Sequence[Seen]) -> List[Seen]:
    """Tables of a folder that are runs: of the same columns, each with poses and with commands; that with the
    likeliest commands first. Empty if there are not several."""
    alike: Dict[FrozenSet[str], List[Seen]] = {}
    for seen in scored:
        if seen.kind == TABLE and not seen.body and any(seen is one for one in with_poses):
            alike.setdefault(frozenset(seen.values), []).append(seen)
    several_alike = [some for some in alike.values() if len(some) > 1]
    return max(several_alike, key=len) if several_alike else []


def _read(source: Container) -> Tuple[List[Tuple[str, Topic, Columns]], List[str]]:
    """The topics that can be read, with their columns, and a line on each of the others."""
    read: List[Tuple[str, Topic, Columns]] = []
    unread: List[str] = []
    for topic, entry in sorted(source.topics.items()):
        try:
            columns = source.table(topic) if entry.count else {}
        except GroundError as error:
            why = str(error).replace(source.path + ": ", "")
            unread.append("#   %s (%s), %d messages, not read: %s" % (topic, entry.kind, entry.count, why))
            continue
        if columns:
            read.append((topic, entry, columns))
        else:
            unread.append("#   %s (%s), without messages" % (topic, entry.kind))
    return read, unread


def _seen(topic: str, kind: str, count: int, columns: Columns, shared: Set[str]) -> Iterator[Seen]:
    """What a topic has, for each body. shared: columns that all tables have, whose clock is one."""
    known = pose_columns.KINDS.get(kind)
    said = getattr(columns, "units", {})
    rows = len(next(iter(columns.values())))
    if kind == TABLE:
        numbers = {name: c.astype(float) for name, c in columns.items() if c.dtype.kind in "biuf"}
        seen = Seen(topic, kind, count, numbers, numbers, np.arange(rows, dtype=float), units=said)
        found = clocks.find(columns, numbers, said, topic, shared)
        seen.clock, seen.clock_fields, seen.times = found.key, found.fields, found.times
        seen.values = {name: column[:MAX_ROWS] for name, column in numbers.items()}
        of_rows = pose_columns.body_columns(columns)[:1]
        names = columns[of_rows[0]].astype(str) if of_rows else np.full(rows, "")
        for body in sorted(set(names[:MAX_ROWS])):
            here, first = names == body, names[:MAX_ROWS] == body
            part = replace(seen, body=body, times=seen.times[:MAX_ROWS][first])
            part.values = {n: v[first] for n, v in seen.values.items()}
            part.whole = {n: v[here] for n, v in numbers.items()}
            _find_pose(part)
            yield part
        return
    whole = {name: columns[name].astype(float) for name in containers.numbers(columns)}
    columns = {name: column[:MAX_ROWS] for name, column in columns.items()}
    names = (
        columns[known.body] if known and known.body in columns else np.full(min(rows, MAX_ROWS), "", object)
    )
    stamps = columns.get(STAMP, columns.get(RECEIVED))
    times = np.arange(len(names), dtype=float) if stamps is None else containers.seconds(stamps)
    for body in sorted(set(names)):
        of_body = names == body
        values = {name: column[: len(names)][of_body] for name, column in whole.items()}
        every = whole if of_body.all() else values
        seen = Seen(topic, kind, count, values, every, times[of_body], str(body))
        _find_pose(seen)
        yield seen


def _find_pose(seen: Seen) -> None:
    """Where a topic has a pose: by its type, or by the names of fields; a quaternion has length 1."""
    if seen.kind not in pose_columns.KINDS:
        free = {name: column for name, column in seen.values.items() if name not in seen.clock_fields}
        seen.poses = sightings.of_columns(free)
        if free and not seen.poses:
            joined = rows_apart.joined(np.column_stack([*free.values()]), seen.times)
            seen.poses = sightings.of_columns(dict(zip(free, joined.T)))
        if seen.poses and not len(seen.rows(seen.pose)[0]):
            _join(seen)
        seen.poses = [pose for pose in seen.poses if len(seen.rows(pose)[0])]
        return
    pose = sightings.fields_of_kind(seen.kind)
    if set(pose.position + pose.rotation) <= set(seen.values):
        length = (seen.rows(pose)[2] ** 2).sum(axis=1)
        if len(length) and (len(pose.rotation) == 1 or np.median(np.abs(length - 1)) < 0.1):
            seen.poses = [pose]


def _join(seen: Seen) -> None:
    """Gives the likeliest pose of a table the numbers that stand in rows of their own."""
    position, rotation = (
        np.column_stack([seen.values[path] for path in paths])
        for paths in (seen.pose.position, seen.pose.rotation)
    )
    largest = np.abs(rotation[np.isfinite(rotation)]).max(initial=0.0)
    turn = 360.0 if largest > 2 * math.pi + 0.01 else 2 * math.pi
    joined = np.column_stack(rows_apart.together(position, rotation, seen.times, turn))
    seen.values = {**seen.values, **dict(zip(seen.pose.position + seen.pose.rotation, joined.T))}


def _axes(position: Array, quaternion: Array) -> str:
    """The axes that fit poses (n, 3) and (n, 4) best, and why."""
    axes, share = units.likely_axes(np.column_stack([position, quaternion]))
    vertical = "xyz".index(axes[-1])
    height = float(np.median(position[:, vertical]))
    sign = "positive: up" if height > 0 else "negative: down" if height < 0 else "0: up or down is not known"
    why = "%s moves least, %.0f%% of the poses are upright by it, and it is mostly %s"
    doubts = MARK + why if share > MIN_UPRIGHT else "these poses are not upright by any axis, " + MARK + why
    doubts = doubts.replace(*CLEAR) if abs(height) > np.ptp(position[:, vertical]) else doubts
    return 'axes: "%s"  # ' % axes + doubts % (axes[-1], 100 * share, sign)


def _pose_order(seen: Seen) -> Tuple[int, float]:
    """The likely types first, and of them the one that moves most; of those that move alike, the first."""
    order = pose_columns.rank(seen.topic.rsplit("/", 1)[-1], seen.kind)
    moved = np.linalg.norm(np.ptp(seen.rows(seen.pose)[1], axis=0))
    return (5 if order is None else order), -float("%.6g" % moved)


def _rate(seen: Seen) -> str:
    times = seen.times[np.isfinite(seen.times)]
    length = float(np.ptp(times)) if len(times) > 1 else 0.0
    return " at %.1f Hz" % ((len(times) - 1) / length) if length > 0 else ""


def _ranges(seen: Seen) -> Iterator[str]:
    """All numbers of a topic with their reach, for who completes the draft."""
    for name, values in seen.values.items():
        there = values[np.isfinite(values)]
        if len(there):
            yield "%s: %.6g to %.6g, first %.6g" % (name, there.min(), there.max(), there[0])


def _place(candidates: Sequence[Seen], in_folder: bool, is_whole: bool = True) -> Iterator[str]:
    """Where poses or commands are. is_whole: whether they are all there."""
    seen = candidates[0]
    if is_whole and seen.kind != TABLE:
        yield "topic: %s" % clocks.quoted(seen.topic)
        yield "type: %s" % seen.kind
        if seen.body:
            yield "body: %s" % clocks.quoted(seen.body)
    elif is_whole and in_folder:
        yield "file: %s" % clocks.quoted(seen.topic)
    if len(candidates) > 1:
        others = ", ".join("%s (%s)" % (c.name, c.kind) for c in candidates[1:])
        yield "# %sothers that could be it: %s" % (MARK, others)


def _pose_lines(candidates: Sequence[Seen], in_folder: bool, is_sided: bool) -> Iterator[str]:
    """Keys of the likeliest poses. is_sided: whether sides of commands verify which way headings count."""
    if not candidates:
        yield "topic: ''  # %snothing seems to have poses; name the fields that have them:" % MARK
        yield "# position: {fields: [X, Y], unit: m}"
        yield "# heading: {field: PSI, unit: rad}"
        yield "# (for sin, cos or a matrix, add a column: psi = atan2(sin, cos) or atan2(r21, r11))"
        return
    chosen, pose = candidates[0], candidates[0].pose
    yield from _place(candidates, in_folder)
    if chosen.kind == TABLE and chosen.body:
        yield "body: %s" % clocks.quoted(chosen.body)
    for other in [one for one in chosen.poses[1:] if one.position != pose.position][:3]:
        yield "# %sother positions: %s" % (MARK, ", ".join(other.position + other.rotation))
    if chosen.kind == TABLE and len(pose.rotation) == 1:
        headings = _other_headings(chosen, pose)
        if headings:
            yield "# %sother headings: %s" % (MARK, ", ".join(headings))
    yield from _valid_lines(chosen)
    if len(pose.rotation) == 4:
        yield from _whole_lines(chosen, pose)
    else:
        yield from _planar_lines(chosen, pose, is_sided)
    if chosen.clock:
        yield "time: %s" % chosen.clock


def _valid_lines(seen: Seen) -> Iterator[str]:
    """The flag of rows that have a pose; in doubt where it may be of something else."""
    flags = [name for name in seen.whole if words.VALID & set(words.split(name))]
    flags = [name for name in flags if set(levels.finite(seen.whole[name])) == {0.0, 1.0}]
    for number, name in enumerate(flags):
        others = set(words.split(name)) - words.VALID - words.MEASURED - words.PLACED - words.TURNED - {"is"}
        share = 100 * np.mean(levels.finite(seen.whole[name]))
        mark = MARK if len(flags) > 1 or others or share < 50 else ""
        line = "%svalid: %s  # %s1 in %.0f%% of the rows"
        yield line % ("# " * (number > 0), clocks.quoted(name), mark, share)


def _other_headings(seen: Seen, pose: sightings.PoseColumns) -> List[str]:
    """Headings that are as likely as the heading of a pose, such as a gyro's beside a mocap's."""
    (name,), turns = pose.rotation, [one.rotation for one in seen.poses if len(one.rotation) == 1]
    names = {turn[0]: None for turn in turns if seen.units.get(turn[0], "") not in RATES}
    least = words.heading(name)[0] - ALIKE
    return [n for n in names if words.heading(n)[0] >= least and not sightings.same(seen.values, name, n)]


def _unit_of(seen: Seen, pose: sightings.PoseColumns, times: Array, position: Array) -> Tuple[str, str]:
    """The unit of a position; why that may be another one, and its speed, with a place for its ranges."""
    likely, fast = units.length_units(times, position)
    every, evidence = {seen.units.get(path, "") for path in pose.position}, "%%s, %.3g a second" % fast
    said = every.pop() if len(every) == 1 else ""
    if pose.kind == "fix":
        is_named = words.axis(pose.position[0])[0] in ("lat", "lon")
        return "deg", ("" if is_named else MARK + "only the numbers suggest degrees, ") + evidence
    if said in {**LENGTHS, **FURTHER_LENGTHS}:
        return said, (MARK + "m is fast, " if said == "m" and likely else "") + evidence
    is_known = seen.kind in pose_columns.KINDS and not likely
    return likely[0] if likely else "m", ("" if is_known else MARK + "no unit is given, ") + evidence


def _position_line(names: str, unit: str, why: str, pose: sightings.PoseColumns, position: Array) -> str:
    ranges = ", ".join(
        "%s %.4g to %.4g" % (path.rsplit(".", 1)[-1], low, high)
        for path, low, high in zip(pose.position, position.min(axis=0), position.max(axis=0))
    )
    return "position: {%sunit: %s}  # %s" % (names, unit, why % ranges)


def _whole_lines(seen: Seen, pose: sightings.PoseColumns) -> Iterator[str]:
    """Keys of a pose with a quaternion."""
    times, position, rotation = seen.rows(pose)
    known = seen.kind in pose_columns.KINDS
    unit, why_unit = _unit_of(seen, pose, times, position)
    names = "" if known else "fields: [%s], " % ", ".join(map(clocks.quoted, pose.position))
    yield _position_line(names, unit, why_unit, pose, position)
    if not known:
        yield "orientation: [%s]" % ", ".join(map(clocks.quoted, pose.rotation))
    if position.shape[1] == 3:
        yield _axes(LENGTHS.get(unit, 1.0) * position, rotation)
    else:
        yield "%s  # %swhere the other axis points up" % (_upward(pose, "# "), MARK)


def _upward(pose: sightings.PoseColumns, mark: str) -> str:
    """The axes of a frame whose vertical axis points up, by the names of the horizontal ones."""
    flat = "".join(words.axis(name)[0] for name in pose.position)
    vertical = next((letter for letter in "zyx" if letter not in flat), "z")
    return '%saxes: "%s"' % (mark, UPWARD[vertical])


def _flat(pose: sightings.PoseColumns, position: Array) -> Tuple[sightings.PoseColumns, Array, str]:
    """A pose by its two horizontal fields, their values (n, 2), and its frame in a line."""
    named = [words.split(path) for path in pose.position]
    turns = MARK * any("ned" not in own for own in named) + "where headings are counter-clockwise from above"
    if all("enu" in own for own in named) or ("east" in named[0] and "north" in named[1]):
        level = sightings.PoseColumns(pose.position[:2], pose.rotation, pose.kind)
        return level, position[:, :2], "%s  # the names say that z is up" % _upward(level, "")
    if position.shape[1] == 2:
        return pose, position, "%s  # %s" % (_upward(pose, "# "), turns)
    spread = np.ptp(position, axis=0)  # the vertical one moves least
    flat = sorted(np.argsort(spread)[1:])
    if spread.min() > 0.5 * spread[flat].min():
        flat = [0, 1]
    (vertical,) = {0, 1, 2} - set(flat)
    height, name = float(np.median(position[:, vertical])), pose.position[vertical]
    pose = sightings.PoseColumns(tuple(pose.position[i] for i in flat), pose.rotation, pose.kind)
    if height > 0:
        line = "%s  # %s%s moves least and is mostly positive: up" % (_upward(pose, ""), MARK, name)
        line = line.replace(*CLEAR) if height > np.ptp(position[:, vertical]) else line
    else:
        line = "%s  # %s, %s is %.3g" % (_upward(pose, "# "), turns, name, height)
    return pose, position[:, flat], line


def _planar_lines(seen: Seen, pose: sightings.PoseColumns, is_sided: bool) -> Iterator[str]:
    """Keys of a pose with a heading; the motion decides how the heading counts, where it does."""
    times, position, rotation = seen.rows(pose)
    known = seen.kind in pose_columns.KINDS
    unit, why_unit = _unit_of(seen, pose, times, position)
    pose, position, frame = _flat(pose, position)
    (name,), metres = pose.rotation, LENGTHS.get(unit, 1.0) * position
    if unit == "deg":
        metres = position * [1.0, math.cos(math.radians(float(np.mean(position[:, 0]))))]
    said = "rad" if known else seen.units.get(name, "")
    turn_unit, turn = _heading_unit(said, times, metres, rotation[:, 0])
    fields, sign, offset, why = pose.position, 1, "", ""
    is_other = units.wraps(rotation[:, 0], {"deg": math.tau, "rad": 360.0}[turn_unit])
    if is_other or (said not in ANGLES and not units.wraps(rotation[:, 0], math.tau / ANGLES[turn_unit])):
        why = ", %s%s" % (MARK, "it steps by a turn in the other unit" if is_other else "no unit is given")
    if turn.is_clear and turn.sign < 0:
        sideways = abs(abs(turn.offset) - math.pi / 2) < math.pi / 4
        if sideways and pose.kind == "xy":  # a compass over east and north
            fields, frame = fields[::-1], ""
            why += ", %sa compass's, by the course: %s is north" % (MARK, fields[0])
        else:
            sign = -1
            why += ", %sfalls where the course rises (agreement %.2f)" % (MARK, turn.resultant)
        if sideways and pose.kind != "xy":  # counter-clockwise from east
            offset = "heading_offset: %.7f  # it counts from east" % (-math.pi / 2)
    elif pose.kind != "xy":
        is_north = turn.is_clear and abs(turn.offset) < NORTH
        why += ", %staken for clockwise from north" % ("" if is_north else MARK)
    elif MARK not in frame and not is_sided and not {"ned", "enu"} & set(words.split(name)):
        why += ", %staken to count as the frame of the position does" % MARK
    names = "" if known else "fields: [%s], " % ", ".join(map(clocks.quoted, fields))
    yield _position_line(names, unit, why_unit, pose, position)
    if not known:
        ends = rotation.min(), rotation.max()
        line = "heading: {field: %s, unit: %s, sign: %d}  # %.4g to %.4g"
        yield line % (clocks.quoted(name), turn_unit, sign, *ends) + why
        yield from filter(None, [offset or (frame if pose.kind == "xy" else "")])


def _heading_unit(said: str, times: Array, position: Array, headings: Array) -> Tuple[str, sightings.Turn]:
    """The unit of headings (n,): what the file says, or by their size, their speed and the course over
    ground; and how they relate to that."""
    turns = {
        unit: sightings.against_course(position, factor * np.asarray(headings))
        for unit, factor in (("rad", 1.0), ("deg", math.pi / 180))
    }
    largest, better = np.abs(headings).max(), turns["deg"].resultant > turns["rad"].resultant
    far = abs(headings[0]) > 2 * math.pi
    degrees = far or units.in_degrees(times, headings) or (better and largest < 361)
    guess = "deg" if largest > 2 * math.pi + 0.01 and degrees else "rad"
    unit = said if said in turns else guess
    return unit, turns[unit]


def _free(seen: Seen) -> Dict[str, Array]:
    """All numbers that are neither a time nor the pose."""
    every = {path for pose in seen.poses[:1] for path in pose.position + pose.rotation}
    return {p: v for p, v in seen.whole.items() if p not in every and p not in seen.clock_fields}


def _command_lines(candidates: Sequence[Seen], every: Sequence[Seen], in_folder: bool) -> Iterator[str]:
    if not candidates:
        yield "topic: ''  # %snothing seems to have commands; name the fields that have them:" % MARK
        yield "# channels: {left: {field: LEFT}, right: {field: RIGHT}}"
        return
    chosen = candidates[0]
    parts = several.of(chosen, every)
    rest = [seen for seen in candidates if not any(seen is part for part in parts)]
    yield from _place([chosen, *rest], in_folder, len(parts) == 1)
    if chosen.clock:
        yield "time: %s" % chosen.clock
    elif chosen.kind != TABLE:
        yield "# time: receipt  # instead of the header's stamp, which a type without one lacks"
    if len(parts) > 1:
        yield "# one for each thruster, by their names: %s" % ", ".join(part.topic for part in parts)
    yield "channels:  # name each as the model names its thruster, or lift"
    further = levels.further(chosen.topic, _free(chosen)) if len(parts) == 1 and chosen.kind == TABLE else []
    if further:
        yield "  # %sother columns that could be commands: %s" % (MARK, ", ".join(further))
    for number, (name, place, keys, why) in enumerate(_channels(parts, in_folder)):
        mark = "# %sfurther: " % MARK if number >= MAX_CHANNELS else ""
        yield "  %s%s: {%sfield: %s}  # %s" % (mark, name, place, keys, why)


def _channels(parts: Sequence[Seen], in_folder: bool) -> Iterator[Tuple[str, str, str, str]]:
    """The names of channels, where they are, their other keys, and why."""
    if len(parts) == 1:
        found = levels.likely(parts[0].topic, _free(parts[0]))
        names = levels.names(found)
        for path, values in found.items():
            meaning, why = levels.meaning(path, values, parts[0].units.get(path, ""))
            doubt = "" if levels.is_named(names[path], path, found) else MARK + "named by its place, "
            yield names[path], "", "%s, %s" % (clocks.quoted(path), meaning), doubt + why
        return
    fields = several.fields(parts)
    for part, name in several.names(parts, fields):
        for path in fields:
            every = np.concatenate([levels.finite(one.whole[path]) for one in parts])
            said = part.units.get(path, "")
            meaning, why = levels.meaning(path, every, said)  # alike for thrusters that are alike
            why = why.replace(levels.reach(every), levels.reach(levels.finite(part.whole[path])))
            place = "file" if in_folder and part.kind == TABLE else "topic"
            clock = ", time: %s" % part.clock.split("  #")[0] if part.clock != parts[0].clock else ""
            yield (
                name[path],
                "%s: %s, " % (place, clocks.quoted(part.topic)),
                "%s, %s%s" % (clocks.quoted(path), meaning, clock),
                why,
            )
