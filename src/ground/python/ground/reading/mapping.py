"""What of a file becomes a recording: topics, fields, units, frames, channels and clocks.

A FieldMapping is the one place that says so, whether a mapping file (schema ground/mapping/1) or options
of the command line have it from. What it leaves open is found in the file, or has a default.
"""

import json
import math
import os
from dataclasses import dataclass, field, replace
from typing import Any, Dict, List, Mapping, Optional, Sequence, Tuple

import numpy as np
import yaml

from ground import _core
from ground.reading.payloads import Load
from ground.support.annotations import Array, Document
from ground.support.bounded_yaml import LOADER
from ground.support.errors import GroundError, reason

SCHEMA = "ground/mapping/1"
LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254}  # [m]
FURTHER_LENGTHS = {"km": 1e3, "ft": 0.3048}  # of files that name them [m]
GEODETIC = "deg"  # unit of positions that are latitude and longitude
ANGLES = {"rad": 1.0, "deg": math.pi / 180}  # [rad]
TIMES = {"s": 10**9, "ms": 10**6, "us": 10**3, "ns": 1, "days": 86400 * 10**9}  # [ns]
# values of a command that mean off and full
COMMANDS = {"normalised": (0.0, 1.0), "percent": (0.0, 100.0), "microseconds": (1000.0, 2000.0)}
LIFT = "lift"  # default name of the channel that is no thruster
HEADER, RECEIPT = "header", "receipt"
RANGE = (0.0, 1.0)  # default range of a command


@dataclass(frozen=True)
class Clock:
    """Where the stamps of a topic are."""

    source: str = ""  #: HEADER, RECEIPT, or empty: the header where there is one
    field: str = ""  #: path of a field that is the time, in place of a source
    unit: str = ""  #: unit of that field; empty: what the file says, or s
    nanoseconds: str = ""  #: path of a field to add [ns]
    date: str = ""  #: path of a field with the date of a time of day
    format: str = ""  #: of a time as text, with the codes of strptime
    rate: float = 0.0  #: numbers of frames, or rows without a field, per second [Hz]
    stamps: str = ""  #: "unpadded": nanoseconds after the point have no leading zeros

    @property
    def is_of_fields(self) -> bool:
        """Whether fields or rows are the time, and no header or receipt."""
        return bool(self.field or self.rate)


@dataclass(frozen=True)
class Poses:
    """Where poses are, and what they are measured in."""

    topic: str = ""  #: empty: the only one that has poses
    file: str = ""  #: pattern of the names of tables that have them
    type: str = ""  #: type of the topic's messages; empty: any
    body: str = ""  #: child frame, or part of the topic's name
    position: Tuple[str, ...] = ()  #: paths of x, y, z or x, y, "-y" mirrors; empty: the type's
    unit: str = ""  #: of lengths, or "deg" for latitude and longitude; empty: what the file says, or m
    scale: float = 1.0
    orientation: Tuple[str, ...] = ()  #: paths of the quaternion's x, y, z, w
    heading: str = ""  #: path of an angle in place of a quaternion
    heading_unit: str = ""  #: empty: what the file says, or rad
    heading_sign: int = 1  #: -1: it, or the quaternion's turn, is positive the other way round
    axes: Optional[str] = None
    heading_offset: Optional[float] = None  #: [rad]
    time: Clock = Clock()


@dataclass(frozen=True)
class CommandChannel:
    """One command, from the value of a field."""

    name: str
    field: str
    off: float = 0.0  #: value that means 0
    full: float = 1.0  #: value that means 1
    scale: float = 1.0
    sign: int = 1
    range: Tuple[float, float] = RANGE
    topic: str = ""  #: that has it; empty: the topic of all commands
    file: str = ""  #: pattern of the names of tables that have it; empty: the pattern of all commands
    time: Optional[Clock] = None  #: its clock; None: the clock of all commands
    is_given: bool = True  #: whether the mapping says what the values mean, and not the file

    def commands(self, values: Array) -> Array:
        """Normalised commands of a field's values."""
        factor = self.sign * self.scale / (self.full - self.off)
        return np.asarray((values - self.off) * factor)


@dataclass(frozen=True)
class Commands:
    """Where commands are, and what their values mean."""

    topic: str = ""  #: empty: the one named sent, else controls
    file: str = ""  #: pattern of the names of tables that have them
    type: str = ""
    channels: Tuple[CommandChannel, ...] = ()  #: empty: left, right, lift as the type has them
    lift: str = LIFT  #: the channel of the lift fan
    empty: str = "held"  #: what a missing value means: the one before is held, or "off"
    time: Clock = Clock()

    def parts(self) -> Tuple["Commands", ...]:
        """The same by where the channels are: one for each topic, file and clock."""
        found: Dict[Tuple[str, str, Clock], List[CommandChannel]] = {}
        for one in self.channels:
            topic = one.topic or ("" if one.file else self.topic)
            file = one.file or ("" if one.topic else self.file)
            found.setdefault((topic, file, one.time or self.time), []).append(one)
        return tuple(
            replace(self, topic=topic, file=file, time=time, channels=tuple(channels))
            for (topic, file, time), channels in found.items()
        ) or (self,)


@dataclass(frozen=True)
class Sensors:
    """Where the craft's gyro and accelerometer are. Units, delay and mounting are found in the data."""

    use: bool = True
    topic: str = ""  #: empty: the craft's telemetry, or the only sensor_msgs/Imu
    file: str = ""  #: name of the table that has them: the table of the poses or of the commands
    type: str = ""
    yaw_rate: str = ""  #: path of the turn about the vertical; empty: the type's
    acceleration: Tuple[str, ...] = ()  #: paths of two horizontal axes
    time: Clock = Clock()


@dataclass(frozen=True)
class Battery:
    """Where the voltage of the craft's battery is."""

    use: bool = True
    topic: str = ""  #: empty: the craft's telemetry, or the only sensor_msgs/BatteryState
    file: str = ""  #: name of the table that has it
    type: str = ""
    voltage: str = ""  #: path of its field; empty: the type's
    unit: str = "V"
    time: Clock = Clock()


@dataclass(frozen=True)
class FieldMapping:
    """What of a file becomes a recording."""

    poses: Poses = Poses()
    commands: Commands = Commands()
    inertial: Sensors = Sensors()
    battery: Battery = Battery()
    clock_offset: float = 0.0  #: added to the stamps of poses [s]
    clock_drift: float = 0.0  #: added to them for each second since the first pose [s/s]
    loads: Tuple[Load, ...] = ()  #: what the craft carried
    rows: Tuple[int, ...] = ()  #: first and last row of tables that are read, from 1; empty: all
    types: Tuple[str, ...] = ()  #: files with definitions of types, or folders of them
    namespace: str = ""  #: of the craft's topics, where a bag has several crafts
    file: str = ""  #: that it was read from
    sources: Mapping[str, str] = field(default_factory=dict)  #: who gave axes and heading_offset
    noise: Optional[Tuple[float, float]] = None  #: of positions [m], headings [rad]; None: their scatter
    frame_rate: Optional[float] = None  #: of the mocap's camera [Hz]; None: of stamps and motion

    def with_options(
        self,
        pose_topic: Optional[str] = None,
        command_topic: Optional[str] = None,
        body: Optional[str] = None,
        axes: Optional[str] = None,
        heading_offset: Optional[float] = None,
        noise: Optional[Sequence[float]] = None,
        frame_rate: Optional[float] = None,
        stamps: Optional[str] = None,
        types: Sequence[str] = (),
        namespace: Optional[str] = None,
    ) -> "FieldMapping":
        """The same with what options say in its place; None leaves it as it is."""
        given = {"axes": axes, "heading_offset": heading_offset, "topic": pose_topic, "body": body}
        changed: Dict[str, Any] = {name: value for name, value in given.items() if value is not None}
        options = {n: "--" + n.replace("_", "-") for n in ("axes", "heading_offset") if n in changed}
        topic = self.commands.topic if command_topic is None else command_topic
        found = replace(
            self,
            poses=replace(self.poses, **changed),
            commands=replace(self.commands, topic=topic),
            types=tuple(types) or self.types,
            namespace=namespace or self.namespace,
            sources={**self.sources, **options},
            noise=self.noise if noise is None else (noise[0], noise[1]),
            frame_rate=frame_rate or self.frame_rate,
        )
        return found if stamps is None else found._with_stamps(stamps)

    def _with_stamps(self, stamps: str) -> "FieldMapping":
        """The same with what all stamps are written like."""

        def changed(clock: Clock) -> Clock:
            return replace(clock, stamps=stamps)

        channels = tuple(
            one if one.time is None else replace(one, time=changed(one.time))
            for one in self.commands.channels
        )
        return replace(
            self,
            poses=replace(self.poses, time=changed(self.poses.time)),
            commands=replace(self.commands, time=changed(self.commands.time), channels=channels),
            inertial=replace(self.inertial, time=changed(self.inertial.time)),
            battery=replace(self.battery, time=changed(self.battery.time)),
        )

    @property
    def of_tables(self) -> bool:
        """Whether it says what tables need: which columns are the time."""
        return self.poses.time.is_of_fields and all(p.time.is_of_fields for p in self.commands.parts())


DEFAULT = FieldMapping()


def load(path: str) -> FieldMapping:
    """The FieldMapping in a file. GroundError names the key that is wrong."""
    try:
        with open(path, encoding="utf-8") as file:
            content = yaml.load(file, LOADER)
    except OSError as error:
        raise GroundError("%s: %s" % (path, reason(error)))
    except (ValueError, yaml.YAMLError, RecursionError) as error:
        raise GroundError("%s: not YAML: %s" % (path, " ".join(str(error).split())))
    if not isinstance(content, dict) or "schema" not in content:
        raise GroundError("%s: not a mapping: write schema: %s" % (path, SCHEMA))
    try:
        root = _plain(content)
        _check(root)
        commands = _commands(root.get("commands", {}))
        poses = _poses(root.get("poses", {}))
        inertial = _sensors(root.get("inertial", {}))
        battery = _battery(root.get("battery", {}))
    except ValueError as error:
        raise GroundError("%s: %s" % (path, error))
    given = {n: path for n in ("axes", "heading_offset") if getattr(poses, n) is not None}
    offset, drift = root.get("clock_offset", 0.0), root.get("clock_drift", 0.0)
    loads = tuple(map(Load.of, root.get("payload", [])))
    rows = tuple(root.get("rows", ()))
    if rows and not 1 <= rows[0] < rows[1]:
        raise GroundError(
            "%s: rows is %s, but must be the first and the last row, from 1" % (path, list(rows))
        )
    folder = os.path.dirname(path)
    types = tuple(os.path.join(folder, os.path.expanduser(one)) for one in root.get("types", ()))
    noise, frame_rate = root.get("noise"), root.get("frame_rate")
    noise = None if noise is None else (noise[0], noise[1])
    found = FieldMapping(poses, commands, inertial, battery, offset, drift, loads, rows, types)
    found = replace(found, file=path, sources=given, noise=noise, frame_rate=frame_rate)
    return found._with_stamps(root["stamps"]) if "stamps" in root else found


def _plain(value: Any, keys: Tuple[str, ...] = ()) -> Any:
    """A document without empty sections. YAML takes a plain `off` for false, which is the name of a key."""
    if isinstance(value, dict):
        named = {"off" if key is False else str(key): inner for key, inner in value.items()}
        for key in named if len(keys) > 1 else ():
            if named[key] is None:
                raise ValueError("%s has no value: put it in" % ".".join((*keys, key)))
        return {k: _plain(inner, (*keys, k)) for k, inner in named.items() if inner is not None}
    if isinstance(value, float) and not math.isfinite(value):
        raise ValueError("%s is not a finite number" % value)
    return [_plain(inner, keys) for inner in value] if isinstance(value, list) else value


def _check(root: Document) -> None:
    """ValueError where a document is not of the schema in mapping.schema.json."""
    import jsonschema

    with open(os.path.join(os.path.dirname(__file__), "mapping.schema.json"), encoding="utf-8") as file:
        validator = jsonschema.Draft7Validator(json.load(file))
    error = jsonschema.exceptions.best_match(validator.iter_errors(root))
    if error is not None:
        what, wrong = error.message[:200], repr(error.instance)
        if "error" in error.schema:  # clearer than what jsonschema says
            what = error.schema["error"] + (", not %s" % wrong if len(wrong) < 50 else "")
        raise ValueError("%s: %s" % (".".join(map(str, error.absolute_path)) or "a key", what))


def _apart(what: str, keys: Document, one: str, *others: str) -> None:
    """ValueError for keys that exclude each other."""
    if one in keys and any(other in keys for other in others):
        raise ValueError("%s.%s and %s are both given; keep one" % (what, one, " or ".join(others)))


def _place(what: str, keys: Document) -> Document:
    """Topic, file, type and time."""
    found: Document = {key: keys.get(key, "") for key in ("topic", "file", "type")}
    return dict(found, type=found["type"].replace("/msg/", "/"), time=_clock(what, keys.get("time", "")))


def _clock(what: str, time: Any) -> Clock:
    clock = Clock(**time) if isinstance(time, dict) else Clock(time)
    if isinstance(time, dict) and not clock.is_of_fields:
        raise ValueError("%s.time: must name a field, or a rate" % what)
    return clock


def _poses(keys: Document) -> Poses:
    _apart("poses", keys, "file", "topic")
    _apart("poses", keys, "heading", "orientation")
    position, heading = keys.get("position", {}), keys.get("heading", {})
    poses = Poses(
        **_place("poses", keys),
        body=keys.get("body", ""),
        position=tuple(position.get("fields", ())),
        unit=position.get("unit", ""),
        scale=position.get("scale", 1.0),
        orientation=tuple(keys.get("orientation", ())),
        heading=heading.get("field", ""),
        heading_unit=heading.get("unit", ""),
        heading_sign=heading.get("sign", 1),
        axes=keys.get("axes"),
        heading_offset=keys.get("heading_offset"),
    )
    if poses.axes is not None:
        try:
            _core.AxisMapping(poses.axes, 0.0)
        except ValueError as error:
            raise ValueError("poses.axes is not a frame: %s" % error)
    if poses.position and not (poses.orientation or poses.heading):
        raise ValueError("poses.position has fields, but neither orientation nor heading has any")
    return poses


def _sensors(keys: Document) -> Sensors:
    _apart("inertial", keys, "file", "topic")
    if ("yaw_rate" in keys) != ("acceleration" in keys):
        raise ValueError("inertial has yaw_rate or acceleration; name the fields of both")
    return Sensors(
        **_place("inertial", keys),
        use=keys.get("use", True),
        yaw_rate=keys.get("yaw_rate", ""),
        acceleration=tuple(keys.get("acceleration", ())),
    )


def _battery(keys: Document) -> Battery:
    _apart("battery", keys, "file", "topic")
    return Battery(
        **_place("battery", keys),
        use=keys.get("use", True),
        voltage=keys.get("voltage", ""),
        unit=keys.get("unit", "V"),
    )


def _commands(keys: Document) -> Commands:
    _apart("commands", keys, "file", "topic")
    channels = tuple(_channel(name, keys["channels"][name]) for name in keys.get("channels", {}))
    names, lift = [channel.name for channel in channels], keys.get("lift", LIFT)
    if lift != LIFT and lift not in names:
        raise ValueError("commands.lift is %s, which is none of the channels: %s" % (lift, ", ".join(names)))
    empty = "held" if keys.get("empty", "held") == "held" else "off"  # YAML takes a plain off for false
    return Commands(**_place("commands", keys), channels=channels, lift=lift, empty=empty)


def _channel(name: str, keys: Document) -> CommandChannel:
    what = "commands.channels." + name
    _apart(what, keys, "unit", "off", "full")
    _apart(what, keys, "file", "topic")
    off, full = COMMANDS[keys.get("unit", "normalised")]
    low, high = keys.get("range", RANGE)
    given: Document = {"off": off, "full": full, **keys, "name": name, "range": (low, high)}
    given["is_given"] = bool({"unit", "off", "full"} & set(keys))
    given.pop("unit", None)
    if "time" in keys:
        given["time"] = _clock(what, keys["time"])
    channel = CommandChannel(**given)
    if channel.off == channel.full:
        raise ValueError("%s.full is the same as off, %g" % (what, channel.off))
    if not low < high:
        raise ValueError("%s.range is %s, but must be two numbers in order" % (what, keys["range"]))
    return channel
