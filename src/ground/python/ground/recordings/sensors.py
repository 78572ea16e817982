"""Reads the samples of a craft's gyro and accelerometer from a file."""

from dataclasses import replace
from typing import Callable, Dict, Optional, Tuple

import numpy as np

from ground.recordings import containers
from ground.recordings.containers import TABLE, Columns, Container
from ground.recordings.inertial import Samples
from ground.recordings.mapping import Clock, FieldMapping, Sensors
from ground.support.annotations import Flags, Indices
from ground.support.errors import GroundError

FIELDS: Dict[
    str, Tuple[str, Tuple[str, ...]]
] = {  # by type: turn about the vertical, two horizontal accelerations
    "ground_msgs/Telemetry": ("gyro[2]", ("acc[0]", "acc[1]")),
    "sensor_msgs/Imu": ("angular_velocity.z", ("linear_acceleration.x", "linear_acceleration.y")),
}

Stamps = Callable[[Columns, Clock, str], Tuple[Indices, Flags]]
Table = Callable[[str], Columns]


def read(source: Container, mapping: FieldMapping, stamps: Stamps, table: Table) -> Optional[Samples]:
    """The Samples in an open Container; None without any. stamps: of a table by a Clock, and its
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
    return Samples(times, values[:, 0], values[:, 1:], "%s (%s)" % (topic, kind))


def _place(source: Container, mapping: FieldMapping, given: Sensors) -> Tuple[str, Sensors]:
    """The topic that has samples, empty without one, and where they are in it."""
    there = {topic: one.kind for topic, one in source.topics.items() if one.count > 0}
    if given.topic or given.file:
        topic = given.topic or given.file
        if topic not in there or (given.type and there[topic] != given.type):
            has = ", ".join("%s (%s)" % item for item in sorted(there.items())) or "no messages at all"
            raise GroundError(
                "%s: there are no %s on %s, which %s names under inertial; it has %s"
                % (source.path, given.type or "messages", topic, mapping.file, has)
            )
        return topic, given
    if given.yaw_rate and mapping.poses.topic in there and there[mapping.poses.topic] == TABLE:
        clock = given.time if given.time.field else mapping.poses.time  # a column of the poses' table
        return mapping.poses.topic, replace(given, time=clock)
    for kind in FIELDS:
        topics = [topic for topic, one in there.items() if one == kind]
        if len(topics) == 1:
            return topics[0], given
    return "", given
