"""Reads recordings from files: bags of ROS 1 and 2, MCAP files, and tables."""

import functools
import os
from dataclasses import replace
from typing import Dict, List, Mapping, Sequence, Tuple

import numpy as np

from ground.reading import (
    commands,
    containers,
    gathered,
    instants,
    pose_columns,
    recorded_files,
    run_settings,
    sensors,
    transforms,
    units,
)
from ground.reading.containers import STAMP, Container, Tables
from ground.reading.mapping import DEFAULT, FieldMapping
from ground.reading.payloads import payload_of
from ground.reading.recording import Recording, checked
from ground.support.annotations import Array, Flags
from ground.support.errors import GroundError
from ground.support.origin import digest_of_files

FARTHEST = 1e5  # largest plausible distance from the first pose [m]
OWN = {"t", "x", "y", "psi", "u", "v", "r"}  # columns of a table that a recording gives
MANY_LOST = 0.1  # share of lost poses from which their axes are checked
MOST_RAW = 2000  # poses as measured that axes are judged by


def read(path: str, mapping: FieldMapping = DEFAULT) -> Recording:
    """The Recording in a file of any kind, by what the mapping says. Raises GroundError."""
    is_table = recorded_files.is_table(path)
    if is_table and not mapping.of_tables:
        if mapping.file:
            parts = [("poses", mapping.poses.time), *(("commands", p.time) for p in mapping.commands.parts())]
            named = list(dict.fromkeys(name for name, clock in parts if not clock.is_of_fields))
            raise GroundError(
                "%s: the mapping %s does not say which column is the time of the %s: write time: "
                "{field: NAME} under %s"
                % (path, mapping.file, " and of the ".join(named), " and ".join(named))
            )
        source = opened(path)
        said = "".join(note + "; " for note in source.warnings if note.startswith("an export"))
        if any(OWN <= source.table(topic).keys() for topic in source.topics):
            said += "ground.Recording.from_frame(pandas.read_csv(FILE)) reads a table written by ground; "
        raise GroundError(
            "%s: %sthe time, pose and command columns are unknown; identify info %s "
            "--write-mapping M.yaml drafts a mapping, and --mapping M.yaml applies it" % (path, said, path)
        )
    files = recorded_files.contents(path, mapping)
    if is_table:
        mapping = recorded_files.chosen(mapping, recorded_files.files_of(path, mapping))
    with Tables(files, mapping.rows) if is_table else opened(path, mapping.types) as container:
        container.path = path
        container.choose(mapping.namespace, mapping.commands.parts()[0].topic)
        found = of_container(container, mapping)
    warnings = [*mapping.undecided, *found.warnings]
    found = replace(found, payload=payload_of(found.name, mapping.loads), warnings=warnings)
    if mapping.rows:  # one of several runs in a file
        return found
    # The description of a folder is not part of a run: the same run may be given without it.
    return replace(
        found, digest=digest_of_files(f for f in files if os.path.basename(f) != recorded_files.METADATA)
    )


def opened(path: str, types: Sequence[str] = ()) -> Container:
    """All that is in a file or folder, of which a mapping may choose. types: files with definitions of types,
    or folders of them. Raises GroundError."""
    if recorded_files.is_table(path):
        return Tables(recorded_files.tables(path) if os.path.isdir(path) else [path])
    from ground.reading import bags  # rosbags is slow to load, and tables need no bags

    return bags.opened(path, types)


def settings_in(path: str, mapping: FieldMapping = DEFAULT) -> run_settings.Settings:
    """The Settings by which the mocap's poses in a bag become world_ned. Raises GroundError."""
    with opened(path, mapping.types) as bag:
        bag.choose(mapping.namespace)
        return run_settings.settings_of(bag, ("axes", "heading_offset"), mapping, [])


def files_in(path: str) -> Dict[str, run_settings.RunFile]:
    """RunFile by `model` and `room` that were recorded with the run. Raises GroundError."""
    with opened(path) as bag:
        return run_settings.flown_by(bag)[1]


def of_container(source: Container, mapping: FieldMapping) -> Recording:
    """The recording in an open Container, by what the mapping says.

    Where the mapping names no topic, poses come from a mocap PoseStamped where there is one, else
    from a PointStamped `pose` or `eta` (x, y, psi), from ground_msgs/State, or from the only topic of
    another type with poses; commands from the topic `sent`, which has what left for the craft, else from
    `controls`. Mocap poses become world_ned by the mapping's axes and heading_offset where given, else by
    the settings that were recorded with the run; planar ones take the heading offset; states are corrected
    already. Raises GroundError.
    """
    path, warnings, topics = source.path, source.warnings, source.topics
    posed, commanded = _topics(source, mapping)
    flown_by, run_files = run_settings.flown_by(source)
    taken = pose_columns.takes(topics[posed].kind, mapping.poses)
    settings = run_settings.settings_of(source, taken, mapping, warnings)
    rows, late = _poses(source, posed, mapping, settings)
    parts = [replace(part, topic=topic) for part, topic in zip(mapping.commands.parts(), commanded)]
    sent = gathered.in_order(mapping.commands.channels, gathered.read(source, parts, warnings))
    sensed = sensors.SensorReader(source, mapping, functools.lru_cache(maxsize=None)(source.table))
    read_from = ", ".join(
        "%s (%s)" % (name, topics[name].kind) for name in dict.fromkeys((posed, *commanded))
    )
    ranges = {channel.name: channel.range for channel in sent.channels}
    return replace(
        checked(path, rows, sent.rows, read_from, warnings, list(ranges), ranges),
        path=str(path),
        namespace=source.namespace,
        lift_channel=sent.lift,
        drives=_drives(source),
        settings=settings,
        changes=run_settings.live_changes(source),
        flown_by=flown_by,
        files=run_files,
        # One recorder received both: if their delays differ by much, their stamps have two clocks.
        inertial=sensed.inertial(),
        voltage=sensed.voltage(),
        noise=mapping.noise,
        frame_rate=mapping.frame_rate,
        clock_offset=0.0 if mapping.clock_offset or mapping.clock_drift else late - sent.delay,
    )


def _poses(
    source: Container, topic: str, mapping: FieldMapping, settings: run_settings.Settings
) -> Tuple[Array, float]:
    """Rows of stamp, x, y, psi in world_ned (n, 4), and the median time from stamp to receipt [s].
    GroundError when they cannot be read."""
    where, warnings, clock = source.place_of(topic), source.warnings, mapping.poses.time
    columns = transforms.of_body(source, topic, source.table(topic), mapping.poses.body, warnings)
    stamps, known = instants.stamps(columns, clock, where, warnings)
    kind = source.topics[topic].kind
    measured = pose_columns.read(columns, stamps, where, kind, mapping.poses, settings, warnings)
    stamps, known = stamps[measured.chosen], known[measured.chosen]
    given = known & ~measured.absent
    instants.check(columns, clock, stamps, given, where, measured.rows)
    valid = given & measured.valid & ~(np.abs(measured.rows[:, :2]) > FARTHEST).any(axis=1)
    if not given.all():
        warnings.append(_without_pose(given))
    if not valid[given].all():
        raw = measured.raw[given] if len(measured.raw) else measured.raw
        warnings.append(_lost(source.path, valid[given], raw, settings))
    times = containers.seconds(stamps[valid])
    shifted = times + mapping.clock_offset + mapping.clock_drift * (times - times[:1])
    rows = gathered.ascending(np.column_stack([shifted, measured.rows[valid]]), "poses", warnings)
    return rows, gathered.delay(columns, measured.chosen, stamps)


def _drives(source: Container) -> Array:
    """When each drive began and the stamp of the last message about it (k, 2) [s], ordered by the latter,
    so that the next message overrules a damaged one."""
    found: Dict[int, int] = {m["began"]: m[STAMP] for m in source.rows("ground_msgs/Drive")}
    ordered = sorted(found.items(), key=lambda row: row[1])
    return containers.seconds(np.array(ordered, np.int64).reshape(-1, 2))


def _without_pose(given: Flags) -> str:
    """How many rows have no pose: some poses are lost, or most rows belong to other messages."""
    if given.mean() > 1 - MANY_LOST:
        return "rows without a pose are left out (%d of %d)" % ((~given).sum(), len(given))
    return "%d of %d rows contain a pose" % (given.sum(), len(given))


def _lost(path: str, valid: Flags, raw: Array, settings: run_settings.Settings) -> str:
    """How many poses are lost, with the axes that would keep them where these are why. GroundError when
    none is left."""
    lost = int((~valid).sum())
    axes, share = units.likely_axes(raw[:: 1 + len(raw) // MOST_RAW]) if len(raw) else ("", 0.0)
    if share < 0.5 or lost < MANY_LOST * len(valid) or "axes" not in settings.taken:
        return "%d poses are invalid and were left out" % lost
    numbers = 100 * lost / len(valid), settings.changes[0].axes, axes, 100 * share
    text = "%.0f%% of the poses do not fit the axes '%s' and were left out: --axes \"%s\" fits %.0f%%"
    if valid.sum() < 2:
        raise GroundError("%s: %s" % (path, text % numbers))
    return text % numbers


def _topics(source: Container, mapping: FieldMapping) -> Tuple[str, List[str]]:
    """Topics of the poses, and of each part of the commands."""
    info, path = source.topics, source.path
    there = ", ".join(map(_described, sorted(info.items()))) or "no messages at all"
    parts = mapping.commands.parts()
    for topic, kind, option in (
        (mapping.poses.topic, mapping.poses.type, "--pose-topic"),
        *((part.topic, part.type, "--command-topic") for part in parts),
    ):
        if topic and (topic not in info or not info[topic].count):
            raise GroundError(
                "%s: no messages on %s, which %s names; its topics: %s"
                % (path, topic, mapping.file or option, there)
            )
        if topic and kind and info[topic].kind != kind:
            raise GroundError("%s: %s contains %s, not %s" % (path, topic, info[topic].kind, kind))
    ranked = commands.ranks(info)
    others = [part.topic for part in parts if part.topic] or list(ranked)
    likely = pose_columns.ranks(info, mapping.poses, others)
    return (
        mapping.poses.topic or _best(path, "poses", likely, "--pose-topic", there),
        [part.topic or _best(path, "controls", ranked, "--command-topic", there) for part in parts],
    )


def _described(entry: Tuple[str, containers.Topic]) -> str:
    """A topic and its type."""
    topic, about = entry
    undefined = "" if not about.undefined else ", whose definition is not in the file: give it by --types"
    empty = "" if about.count else ", without messages"
    return "%s (%s%s%s)" % (topic, about.kind, empty, undefined)


def _best(path: str, what: str, ranks: Mapping[str, int], option: str, there: str) -> str:
    """The topic of the lowest rank. GroundError when there is none or several have it."""
    if not ranks:
        raise GroundError(
            "%s: no %s in this bag; it has %s; %s names another topic, and identify info "
            "--write-mapping drafts a mapping for other fields and units" % (path, what, there, option)
        )
    first, *same = sorted(topic for topic, rank in ranks.items() if rank == min(ranks.values()))
    if same:
        named = ", ".join([first, *same])
        raise GroundError(
            "%s: several topics could be the %s: %s; choose one by %s" % (path, what, named, option)
        )
    return first
