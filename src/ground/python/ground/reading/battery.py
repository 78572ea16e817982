"""Reads the voltage of a craft's battery from a file."""

from dataclasses import dataclass
from typing import Dict, Optional

import numpy as np

from ground.reading import containers
from ground.reading.containers import Container
from ground.reading.mapping import Battery, Clock, FieldMapping
from ground.reading.sensors import Stamps, Table, named_topic, only_topic
from ground.support.annotations import Array, Document
from ground.support.errors import GroundError

FIELDS: Dict[str, str] = {"ground_msgs/Telemetry": "voltage", "sensor_msgs/BatteryState": "voltage"}
VOLTS = {"V": 1.0, "mV": 1e-3}


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

    def describe(self, zero: float) -> Document:
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


def read(source: Container, mapping: FieldMapping, stamps: Stamps, table: Table) -> Optional[Voltage]:
    """The Voltage in an open Container; None without any. stamps: of a table by a Clock, and its
    name; table: the columns of a topic. GroundError where the mapping names something else than there is."""
    given = mapping.battery
    topic = _topic(source, mapping, given, table) if given.use else ""
    if not topic:
        return None
    kind, where = source.topics[topic].kind, "%s: %s" % (source.path, topic)
    field = given.voltage or FIELDS.get(kind, "")
    if not field:
        raise GroundError(
            "%s: which field of %s is the voltage is not known; name battery.voltage in a mapping"
            % (where, kind)
        )
    columns = table(topic)
    if not given.voltage and containers.column(columns, field) is None:
        return None  # telemetry of an earlier version
    volts = containers.values(columns, [field], where)[:, 0] * VOLTS[given.unit]
    stamped, known = stamps(columns, _clock(mapping, given, topic), where)
    times = containers.seconds(stamped)
    good = known & np.isfinite(volts) & (volts > 0)
    if good.sum() < 2:  # a craft that does not measure it leaves zeros
        return None
    order = np.argsort(times[good], kind="stable")
    source_name = "%s (%s)" % (topic, kind)
    return Voltage(times[good][order], volts[good][order], source_name, int((~good).sum()))


def _clock(mapping: FieldMapping, given: Battery, topic: str) -> Clock:
    """Its own clock, or that of the table which it shares."""
    if given.time.is_of_fields or given.time.source:
        return given.time
    shared = {mapping.commands.topic: mapping.commands.time, mapping.poses.topic: mapping.poses.time}
    return shared.get(topic, given.time)


def _topic(source: Container, mapping: FieldMapping, given: Battery, table: Table) -> str:
    """The topic that has the voltage; empty: none."""
    named = named_topic(source, given, "battery", mapping.file)
    if given.voltage and not named:  # a column of a table that the run is read from anyway
        for other in (mapping.poses.topic, mapping.commands.topic):
            if other in source.topics and containers.column(table(other), given.voltage) is not None:
                return other
        raise GroundError(
            "%s: neither the poses nor the commands have a field %s, which %s names as battery.voltage; "
            "name its topic or file" % (source.path, given.voltage, mapping.file)
        )
    return named or only_topic(source, FIELDS)
