"""Reads what a craft measures itself from a file: gyro, accelerometer and the voltage of its battery."""

import itertools
from dataclasses import dataclass
from typing import Callable, Dict, Optional, Sequence, Tuple, Union

import numpy as np

from ground.poses.inertial import InertialSamples
from ground.reading import containers, instants
from ground.reading.containers import Columns, Container
from ground.reading.mapping import Battery, Clock, FieldMapping, Sensors
from ground.support.annotations import Array
from ground.support.errors import GroundError

# Fields by type of messages: turn about the vertical and two horizontal accelerations, or the voltage
FIELDS: Dict[str, Dict[str, Tuple[str, ...]]] = {
    "inertial": {
        "ground_msgs/Telemetry": ("gyro[2]", "acc[0]", "acc[1]"),
        "sensor_msgs/Imu": ("angular_velocity.z", "linear_acceleration.x", "linear_acceleration.y"),
    },
    "battery": {"ground_msgs/Telemetry": ("voltage",), "sensor_msgs/BatteryState": ("voltage",)},
}
KEYS = {"inertial": "inertial.yaw_rate and inertial.acceleration", "battery": "battery.voltage"}
VOLTS = {"V": 1.0, "mV": 1e-3}

Table = Callable[[str], Columns]


@dataclass(frozen=True, eq=False)
class Voltage:
    """The voltage of a battery at its terminals."""

    times: Array  #: (n,) ascending [s], on the clock of the commands
    volts: Array  #: (n,) [V], positive
    source: str  #: topic that it was read from
    unusable: int = 0  #: samples that were not positive numbers, left out

    def rows(self, zero: float) -> Array:
        """Rows of time, voltage (n, 2) on a clock that is 0 at an instant [s]."""
        return np.column_stack([self.times - zero, self.volts])

    def describe(self, zero: float) -> Dict[str, object]:
        """The values of a JSON document; times on the run's clock."""
        count, span = len(self.times), float(np.ptp(self.times))
        return {
            "source": self.source,
            "rate": (count - 1) / span if span > 0 else 0.0,
            "start": float(self.times[0] - zero),
            "end": float(self.times[-1] - zero),
            "first": float(np.median(self.volts[: 1 + count // 20])),
            "last": float(np.median(self.volts[-1 - count // 20 :])),
            "least": float(self.volts.min()),
            "most": float(self.volts.max()),
            "unusable": self.unusable,
        }


@dataclass(frozen=True)
class SensorReader:
    """What a file has of the craft's sensors. table: the columns of a topic. GroundError where the mapping
    names something else than there is."""

    source: Container
    mapping: FieldMapping
    table: Table

    def inertial(self) -> Optional[InertialSamples]:
        """The samples of gyro and accelerometer; None without any."""
        given = self.mapping.inertial
        found = self._samples("inertial", given, [given.yaw_rate, *given.acceleration])
        if found is None:
            return None
        times, values, source = found
        good = np.isfinite(times) & np.isfinite(values).all(axis=1)
        values, times = values[good], times[good]
        if len(times) < 2 or not np.ptp(values[:, 0]) > 0:  # a craft without sensors leaves zeros
            return None
        return InertialSamples(times, values[:, 0], values[:, 1:], source)

    def voltage(self) -> Optional[Voltage]:
        """The voltage of the battery; None without any."""
        given = self.mapping.battery
        found = self._samples("battery", given, [given.voltage])
        if found is None:
            return None
        times, values, source = found
        volts = values[:, 0] * VOLTS[given.unit]
        good = np.isfinite(times) & np.isfinite(volts) & (volts > 0)
        if good.sum() < 2:  # a craft that does not measure it leaves zeros
            return None
        order = np.argsort(times[good], kind="stable")
        return Voltage(times[good][order], volts[good][order], source, int((~good).sum()))

    def _samples(
        self, section: str, given: Union[Battery, Sensors], own: Sequence[str]
    ) -> Optional[Tuple[Array, Array, str]]:
        """Times (n,) [s], NaN without one, values (n, k) and their source, by the fields that a section of
        the mapping names (own), else by the type's fields."""
        topic = self._topic(section, given, own[0]) if given.use else ""
        if not topic:
            return None
        kind, where = self.source.topics[topic].kind, self.source.place_of(topic)
        usual = FIELDS[section].get(kind, ())
        paths = [one or other for one, other in itertools.zip_longest(own, usual, fillvalue="")]
        if not paths[0]:
            raise GroundError(
                "%s: its fields in %s are not known; name %s in a mapping" % (where, kind, KEYS[section])
            )
        columns = self.table(topic)
        if not own[0] and containers.column(columns, paths[0]) is None:
            return None  # telemetry of an earlier version
        values = containers.values(columns, paths, where)
        stamped, known = instants.stamps(columns, self._clock(given.time, topic), where, [])
        times = np.where(known, containers.seconds(stamped), np.nan)
        return times, values, "%s (%s)" % (topic, kind)

    def _topic(self, section: str, given: Union[Battery, Sensors], field: str) -> str:
        """The topic or table that has the samples; empty: none. field: that the mapping names."""
        source, file = self.source, self.mapping.file
        topic = given.topic or given.file
        there = {name: one.kind for name, one in source.topics.items() if one.count > 0}
        if topic and (topic not in there or (given.type and there[topic] != given.type)):
            has = ", ".join("%s (%s)" % item for item in sorted(there.items())) or "no messages at all"
            raise GroundError(
                "%s: there are no %s on %s, which %s names under %s; its topics: %s"
                % (source.path, given.type or "messages", topic, file, section, has)
            )
        if topic:
            return topic
        for other in (self.mapping.poses.topic, self.mapping.commands.topic) if field else ():
            if other in source.topics and containers.column(self.table(other), field) is not None:
                return other  # a column of a table that the run is read from anyway
        only = [topics[0] for topics in map(source.of_kind, FIELDS[section]) if len(topics) == 1]
        if field and not only:
            raise GroundError(
                "%s: neither the poses nor the commands contain a field %s, which %s names as %s; "
                "name its topic or file" % (source.path, field, file, KEYS[section])
            )
        return only[0] if only else ""

    def _clock(self, own: Clock, topic: str) -> Clock:
        """Its own clock, or the clock of the table which it shares."""
        if own.is_of_fields or own.source:
            return own
        mapping = self.mapping
        shared = {mapping.commands.topic: mapping.commands.time, mapping.poses.topic: mapping.poses.time}
        return shared.get(topic, own)
