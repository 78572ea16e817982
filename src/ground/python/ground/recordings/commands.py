"""Commands of topics with any type that has numbers, and of tables, by named channels."""

from typing import Mapping, Set, Tuple

import numpy as np

from ground.recordings import containers
from ground.recordings.containers import Columns, Topic
from ground.recordings.mapping import Channel, Commands
from ground.support.annotations import Array
from ground.support.errors import GroundError

OWN = "ground_msgs/Controls"
CHANNELS = ("left", "right", "lift")  # channels of a craft with unnamed thrusters
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
    """How likely topics have the commands where none is named: 0 is best."""
    likely = {OWN: 0, "geometry_msgs/PointStamped": 1}
    return {
        name: likely[topic.kind]
        for name, topic in topics.items()
        if name.rsplit("/", 1)[-1] == "controls" and topic.kind in likely and topic.count
    }


def channels_of(
    columns: Columns, kind: str, commands: Commands, where: str
) -> Tuple[Tuple[Channel, ...], str]:
    """The channels of a topic and the name of that of the lift fan. Those of ground_msgs/Controls name the
    channels of a craft that lists its thrusters. GroundError where they are not known."""
    if commands.channels:
        return commands.channels, commands.lift
    if kind not in KINDS:
        raise GroundError(
            "%s: which numbers of %s are commands is not known; name the channels in a mapping "
            "(identify info --write-mapping drafts one)" % (where, kind)
        )
    names = _named(columns, where) if kind == OWN else ()
    if not names:
        return tuple(Channel(n, path) for n, path in zip(CHANNELS, KINDS[kind])), commands.lift
    thrusters = [Channel(name, "thrusters[%d]" % i, range=(-1.0, 1.0)) for i, name in enumerate(names[:-1])]
    return (*thrusters, Channel(names[-1], "lift")), names[-1]


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


def read(columns: Columns, channels: Tuple[Channel, ...], where: str) -> Array:
    """Normalised commands (n, c) by `channels`. GroundError when one has no column."""
    rows = containers.values(columns, [channel.field for channel in channels], where)
    return np.column_stack([channel.commands(v) for channel, v in zip(channels, rows.T)])
