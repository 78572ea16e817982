"""Commands of topics with any type that has numbers, and of tables, by named channels."""

from dataclasses import replace
from typing import List, Mapping, Set, Tuple

import numpy as np

from ground.reading import containers
from ground.reading.containers import Columns, Topic
from ground.reading.mapping import COMMANDS, CommandChannel, Commands
from ground.support.annotations import Array, Flags
from ground.support.errors import GroundError

OWN = "ground_msgs/Controls"
CHANNELS = ("left", "right", "lift")  # channels of a craft with unnamed thrusters
SHORT = 0.1  # share of the commands below which what was sent is only a part of the run
# Where messages have left, right and lift, unless a mapping says more.
KINDS = {
    OWN: CHANNELS,
    "geometry_msgs/PointStamped": ("point.x", "point.y", "point.z"),
    "geometry_msgs/Vector3Stamped": ("vector.x", "vector.y", "vector.z"),
    "geometry_msgs/Point": ("x", "y", "z"),
    "geometry_msgs/Vector3": ("x", "y", "z"),
    "std_msgs/Float32MultiArray": ("data[0]", "data[1]", "data[2]"),
    "std_msgs/Float64MultiArray": ("data[0]", "data[1]", "data[2]"),
}


def ranks(topics: Mapping[str, Topic]) -> Mapping[str, int]:
    """How likely topics have the commands where none is named: 0 is best. What has left for the craft counts
    if it is about as long as what was commanded: it repeats at least 50 times a second."""
    likely = [("sent", OWN), ("controls", OWN), ("controls", "geometry_msgs/PointStamped")]
    most = max((topic.count for topic in topics.values() if topic.kind == OWN), default=0)
    ends = {name: (name.rsplit("/", 1)[-1], topic.kind) for name, topic in topics.items() if topic.count}
    ends = {n: end for n, end in ends.items() if end[0] != "sent" or topics[n].count > SHORT * most}
    return {name: likely.index(end) for name, end in ends.items() if end in likely}


def channels_of(
    columns: Columns, kind: str, commands: Commands, where: str
) -> Tuple[Tuple[CommandChannel, ...], str]:
    """The channels of a topic, and the name of the lift fan's channel. If the craft lists its thrusters,
    ground_msgs/Controls has the names of its channels. GroundError if the channels are not known."""
    if commands.channels:
        return commands.channels, commands.lift
    if kind not in KINDS:
        raise GroundError(
            "%s: the command fields of %s are unknown; name the channels in a mapping "
            "(identify info --write-mapping drafts one)" % (where, kind)
        )
    names = _named(columns, where) if kind == OWN else ()
    if not names:
        return tuple(CommandChannel(n, path) for n, path in zip(CHANNELS, KINDS[kind])), commands.lift
    thrusters = [
        CommandChannel(name, "thrusters[%d]" % i, range=(-1.0, 1.0)) for i, name in enumerate(names[:-1])
    ]
    return (*thrusters, CommandChannel(names[-1], "lift")), names[-1]


def _named(columns: Columns, where: str) -> Tuple[str, ...]:
    """The channels that ground_msgs/Controls name; bags of earlier versions have none."""
    found = [columns[n] for n in sorted(columns) if n.startswith("channels[")]
    crafts: Set[Tuple[str, ...]] = {tuple(filter(None, row)) for row in zip(*found)} or {()}
    one = crafts.pop()
    if crafts or (one and "thrusters[%d]" % (len(one) - 2) not in columns):
        others = [", ".join(craft or CHANNELS) for craft in (one or CHANNELS, *crafts)]
        text = "%s: the commands are not all of one craft: some are for %s"
        raise GroundError(text % (where, ", others for ".join(others)))
    return one


def read(
    columns: Columns,
    channels: Tuple[CommandChannel, ...],
    where: str,
    empty: str,
    known: Flags,
    backward: bool,
    notes: List[str],
) -> Tuple[Array, Flags]:
    """Normalised commands (n, c) by `channels`, and which rows have some (n,). empty: what a missing value
    means, "held" or "off"; known: rows that have a time (n,); backward: whether the latest rows come first;
    notes: told what is missing. GroundError when a channel has no column."""
    channels = tuple(_by_file(one, containers.unit(columns, one.field), notes) for one in channels)
    rows = containers.values(columns, [channel.field for channel in channels], where)
    found = np.column_stack([channel.commands(v) for channel, v in zip(channels, rows.T)])
    missing = ~np.isfinite(found)
    given = known & ~missing.all(axis=1)
    if empty == "off":
        counts = ["%s %d" % (c.name, n) for c, n in zip(channels, missing.sum(axis=0)) if n]
        if counts:
            notes.append("missing values of commands are read as off: %s" % ", ".join(counts))
        return np.where(missing, 0.0, found), known
    if not given.all():
        notes.append("%d of %d rows contain a command" % (given.sum(), len(given)))
    for number, channel in enumerate(channels):
        gone = missing[:, number] & given
        if not gone.any():
            continue
        found[:, number] = _held(found[:, number], backward)
        held = int((gone & np.isfinite(found[:, number])).sum())
        if held:
            notes.append(
                "command %s is missing in %d rows and held from the one before (empty: off under commands "
                "in a mapping reads it as off)" % (channel.name, held)
            )
    before = given & ~np.isfinite(found).all(axis=1)
    if before.any():
        notes.append("rows before the first command of each channel are left out (%d)" % before.sum())
    return found, given & ~before


def _held(values: Array, backward: bool) -> Array:
    """Values (n,) of which missing ones are those before them."""
    ordered = values[::-1] if backward else values
    there = np.where(np.isfinite(ordered), np.arange(len(ordered)), 0)
    found = ordered[np.maximum.accumulate(there)]
    return np.asarray(found[::-1] if backward else found)


def _by_file(channel: CommandChannel, unit: str, notes: List[str]) -> CommandChannel:
    """A channel whose values mean what the unit in the file says, where the mapping leaves it open."""
    named = {"%": "percent", "us": "microseconds"}.get(unit)
    if channel.is_given or named is None:
        return channel
    off, full = COMMANDS[named]
    notes.append("command %s is in %s, as its column says" % (channel.name, named))
    return replace(channel, off=off, full=full)
