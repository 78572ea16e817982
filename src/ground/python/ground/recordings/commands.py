"""Commands of messages of any type that has numbers, and of tables, by named channels."""

from dataclasses import dataclass, field
from typing import Mapping, Optional, Tuple

import numpy as np

from ground.annotations import Array, Message, Time
from ground.errors import GroundError
from ground.recordings import fields
from ground.recordings.bag_reader import Topic
from ground.recordings.batches import Batch
from ground.recordings.clocks import batch_stamps, stamps
from ground.recordings.mapping import Channel, Commands

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


def rank(name: str, kind: str) -> Optional[int]:
    """How likely a topic whose last name is `name` has the commands: 0 is best; None: not at all."""
    if name != "controls":
        return None
    return {OWN: 0, "geometry_msgs/PointStamped": 1}.get(kind)


def named(info: Mapping[str, Topic], commands: Commands, where: str) -> str:
    """The topic that a mapping names; GroundError when its fields are not known."""
    topic, kind = commands.topic, info[commands.topic].msg_type
    if commands.type and kind != commands.type:
        raise GroundError("%s: %s has %s, not %s" % (where, topic, kind, commands.type))
    if kind not in KINDS and not commands.channels:
        raise GroundError(
            "%s: which numbers of %s (%s) are commands is not known; name its channels in a mapping "
            "(identify info --write-mapping drafts one)" % (where, topic, kind)
        )
    return topic


def default_channels(kind: str) -> Tuple[Channel, ...]:
    """The channels of a type in KINDS."""
    return tuple(Channel(name, path) for name, path in zip(CHANNELS, KINDS[kind]))


@dataclass
class CommandReader:
    """Gives the commands of messages of one topic. Those of ground_msgs/Controls name the channels of a
    craft that lists its thrusters."""

    where: str  # file and topic, for errors
    kind: str
    commands: Commands
    channels: Tuple[Channel, ...] = field(init=False)
    lift: str = field(init=False)  # the channel of the lift fan

    def __post_init__(self) -> None:
        self._stamp = stamps(self.commands.time, self.where)
        if not self.commands.channels and self.kind not in KINDS:
            raise GroundError(
                "%s: which numbers are commands is not known; name the channels in a mapping "
                "(identify info --write-mapping drafts one)" % self.where
            )
        self.channels = self.commands.channels or default_channels(self.kind)
        self.lift = self.commands.lift
        self._own = self.kind == OWN and not self.commands.channels
        self._named: Optional[Tuple[str, ...]] = None  # channels that the messages name
        self._take(self.channels)

    def _take(self, channels: Tuple[Channel, ...]) -> None:
        self.channels = channels
        self._paths = [channel.field for channel in channels]
        self._get = fields.getter(self._paths)

    def _name(self, message: Message) -> None:
        """Takes the channels that a message names; bags of earlier versions have none."""
        names = tuple(getattr(message, "channels", ()))
        if names == self._named:
            return
        if self._named is not None or (names and len(names) != len(message.thrusters) + 1):
            raise GroundError(
                "%s: the commands are not all of one craft: some are for %s, others for %s"
                % (
                    self.where,
                    ", ".join(self._named or CHANNELS),
                    ", ".join(names or CHANNELS),
                )
            )
        self._named = names
        if not names:
            return
        self.lift = names[-1]
        thrusters = [
            Channel(name, "thrusters[%d]" % i, range=(-1.0, 1.0)) for i, name in enumerate(names[:-1])
        ]
        self._take((*thrusters, Channel(self.lift, "lift")))

    def __call__(
        self, message: Message, received: Optional[Time]
    ) -> Tuple[Time, Tuple[float, ...]]:
        """Stamp and values of a message's channels, as they are in the file."""
        if self._own:
            self._name(message)
        try:
            values = tuple(float(value) for value in self._get(message))
        except (LookupError, TypeError, ValueError):
            raise fields.missing(self.where, "a message", self._paths, message)
        return self._stamp(message, received), values

    def of_batch(self, batch: Batch) -> Optional[Array]:
        """Rows of stamp and values of all messages; None where they have to be read one by one."""
        stamps = batch_stamps(self.commands.time, batch)
        if self._own:
            for group in batch.groups:
                self._name(group.sample)
        values = batch.values(self._paths)
        return None if stamps is None or values is None else np.column_stack([stamps[0], values])

    def normalised(self, rows: Array) -> Array:
        """Rows of stamp and values, as commands in place of values."""
        table = rows.copy()
        if self.commands.channels:
            for number, channel in enumerate(self.channels, 1):
                table[:, number] = channel.commands(table[:, number])
        return table
