"""Reads the samples of a craft's gyro and accelerometer from a file."""

from dataclasses import replace
from typing import Callable, Dict, Iterable, Optional, Tuple, Union

import numpy as np

from ground.poses.inertial import InertialSamples
from ground.reading import containers
from ground.reading.containers import TABLE, Columns, Container
from ground.reading.mapping import Battery, Clock, FieldMapping, Sensors
from ground.support.annotations import Flags, Indices
from ground.support.errors import GroundError

# By type: turn about the vertical, two horizontal accelerations
FIELDS: Dict[str, Tuple[str, Tuple[str, ...]]] = {
    "ground_msgs/Telemetry": ("gyro[2]", ("acc[0]", "acc[1]")),
    "sensor_msgs/Imu": ("angular_velocity.z", ("linear_acceleration.x", "linear_acceleration.y")),
}

Stamps = Callable[[Columns, Clock, str], Tuple[Indices, Flags]]
Table = Callable[[str], Columns]


def read(source: Container, mapping: FieldMapping, stamps: Stamps, table: Table) -> Optional[InertialSamples]:
    """The InertialSamples in an open Container; None without any. stamps: of a table by a Clock, and its
    name; table: the columns of a topic.
    GroundError where the mapping names something else than there is."""
    given = mapping.inertial
    topic, given = _place(source, mapping, given) if given.use else ("", given)
    if not topic:
        return None
    kind, where = source.topics[topic].kind, "%s: %s" % (source.path, topic)
    turn, axes = FIELDS.get(kind, ("", ()))
    turn, axes = given.yaw_rate or turn, given.acceleration or axes
    if not turn:
        raise GroundError(
            "%s: which fields of %s are sensors is not known; name inertial.yaw_rate and "
            "inertial.acceleration in a mapping" % (where, kind)
        )
    columns = table(topic)
    values = containers.values(columns, [turn, *axes], where)
    stamped, known = stamps(columns, given.time, where)
    times = containers.seconds(stamped)
    good = known & np.isfinite(values).all(axis=1)
    values, times = values[good], times[good]
    if len(times) < 2 or not np.ptp(values[:, 0]) > 0:  # a craft without sensors leaves zeros
        return None
    return InertialSamples(times, values[:, 0], values[:, 1:], "%s (%s)" % (topic, kind))


def _place(source: Container, mapping: FieldMapping, given: Sensors) -> Tuple[str, Sensors]:
    """The topic that has samples, empty without one, and where they are in it."""
    named = named_topic(source, given, "inertial", mapping.file)
    if given.yaw_rate and not named and mapping.poses.topic in source.of_kind(TABLE):
        clock = given.time if given.time.field else mapping.poses.time  # a column of the poses' table
        return mapping.poses.topic, replace(given, time=clock)
    return named or only_topic(source, FIELDS), given


def named_topic(source: Container, given: Union[Battery, Sensors], section: str, file: str) -> str:
    """The topic or table that a section of a mapping file names; empty: none. GroundError where it is not
    there."""
    topic = given.topic or given.file
    there = {name: one.kind for name, one in source.topics.items() if one.count > 0}
    if topic and (topic not in there or (given.type and there[topic] != given.type)):
        has = ", ".join("%s (%s)" % item for item in sorted(there.items())) or "no messages at all"
        raise GroundError(
            "%s: there are no %s on %s, which %s names under %s; it has %s"
            % (source.path, given.type or "messages", topic, file, section, has)
        )
    return topic


def only_topic(source: Container, kinds: Iterable[str]) -> str:
    """The only topic of the first of some types of which there is one; empty: none."""
    found = map(source.of_kind, kinds)
    return next((topics[0] for topics in found if len(topics) == 1), "")
