"""What of a file becomes a recording: topics, fields, units, frames, channels and clocks.

A FieldMapping is the one place that says so, whether a mapping file (schema ground/mapping/1) or options
of the command line have it from. What it leaves open is found in the file, or has a default.
"""

import json
import math
import os
from dataclasses import dataclass, field, replace
from typing import Any, Dict, Iterable, Iterator, List, Mapping, Optional, Sequence, Tuple, Type, TypeVar

import numpy as np
import yaml

from ground import _core
from ground.reading.payloads import Load
from ground.support.annotations import Array
from ground.support.bounded_yaml import LOADER
from ground.support.errors import GroundError, did_you_mean, reason

_T = TypeVar("_T")
_Section = TypeVar("_Section", "Poses", "Commands", "Sensors", "Battery")

SCHEMA = "ground/mapping/1"
LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254}  # [m]
FURTHER_LENGTHS = {"km": 1e3, "ft": 0.3048}  # of files that name them [m]
GEODETIC = "deg"  # unit of positions that are latitude and longitude
ANGLES = {"rad": 1.0, "deg": math.pi / 180}  # [rad]
TIMES = {"s": 10**9, "ms": 10**6, "us": 10**3, "ns": 1, "days": 86400 * 10**9}  # [ns]
# values of a command that mean off and full
COMMANDS = {"normalised": (0.0, 1.0), "percent": (0.0, 100.0), "microseconds": (1000.0, 2000.0)}
LIFT = "lift"  # default name of the channel that is no thruster
# keys of a section in the section: the fields of Poses that have them
NESTED = {
    "position": {"fields": "position", "unit": "unit", "scale": "scale"},
    "heading": {"field": "heading", "unit": "heading_unit", "sign": "heading_sign"},
}
HEADER, RECEIPT = "header", "receipt"
RANGE = (0.0, 1.0)  # default range of a command
UNDECIDED = "undecided: "  # in a comment: the line is a guess without evidence


@dataclass(frozen=True)
class Clock:
    """Where the stamps of a topic are."""

    source: str = ""  #: HEADER, RECEIPT, or empty: the header where there is one
    field: str = ""  #: path of a field that is the time, instead of a source
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
    valid: str = ""  #: path of a field that is 0 where there is no pose
    position: Tuple[str, ...] = ()  #: paths of x, y, z or x, y, "-y" mirrors; empty: the type's
    unit: str = ""  #: of lengths, or "deg" for latitude and longitude; empty: what the file says, or m
    scale: float = 1.0
    orientation: Tuple[str, ...] = ()  #: paths of the quaternion's x, y, z, w
    heading: str = ""  #: path of an angle instead of a quaternion
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
    namespace: str = ""  #: of the craft's topics, where a bag has several craft
    file: str = ""  #: that it was read from
    sources: Mapping[str, str] = field(default_factory=dict)  #: who gave axes and heading_offset
    noise: Optional[Tuple[float, float]] = None  #: of positions [m], headings [rad]; None: their scatter
    frame_rate: Optional[float] = None  #: of the mocap's camera [Hz]; None: of stamps and motion
    undecided: Tuple[str, ...] = ()  #: warnings of lines in the file that are left to decide

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
        options = {"axes": axes, "heading_offset": heading_offset}
        poses = replace(
            self.poses,
            topic=_either(pose_topic, self.poses.topic),
            body=_either(body, self.poses.body),
            axes=_either(axes, self.poses.axes),
            heading_offset=_either(heading_offset, self.poses.heading_offset),
        )
        found = replace(
            self,
            poses=poses,
            commands=replace(self.commands, topic=_either(command_topic, self.commands.topic)),
            types=tuple(types) or self.types,
            namespace=namespace or self.namespace,
            sources={
                **self.sources,
                **{n: "--" + n.replace("_", "-") for n, value in options.items() if value is not None},
            },
            noise=self.noise if noise is None else (noise[0], noise[1]),
            frame_rate=frame_rate or self.frame_rate,
        )
        return found if stamps is None else found._with_stamps(stamps)

    def _with_stamps(self, stamps: str) -> "FieldMapping":
        """The same with what all stamps are written like."""

        def timed(section: _Section) -> _Section:
            return replace(section, time=replace(section.time, stamps=stamps))

        channels = tuple(
            one if one.time is None else replace(one, time=replace(one.time, stamps=stamps))
            for one in self.commands.channels
        )
        commands = replace(timed(self.commands), channels=channels)
        sensors = {"inertial": timed(self.inertial), "battery": timed(self.battery)}
        return replace(self, poses=timed(self.poses), commands=commands, **sensors)

    @property
    def of_tables(self) -> bool:
        """Whether it says what tables need: which columns are the time."""
        return self.poses.time.is_of_fields and all(p.time.is_of_fields for p in self.commands.parts())


DEFAULT = FieldMapping()


def _either(option: _T, own: _T) -> _T:
    """What an option says; its own value without one."""
    return own if option is None else option


def load(path: str) -> FieldMapping:
    """The FieldMapping in a file. GroundError names the key that is wrong."""
    try:
        with open(path, encoding="utf-8") as file:
            text = file.read()
        content = yaml.load(text, LOADER)
    except OSError as error:
        raise GroundError("%s: %s" % (path, reason(error)))
    except (ValueError, yaml.YAMLError, RecursionError) as error:
        why = " ".join(str(error).split()).replace('"<unicode string>", ', "")
        raise GroundError("%s: not YAML: %s" % (path, why))
    if not isinstance(content, dict) or "schema" not in content:
        raise GroundError("%s: not a mapping: write schema: %s" % (path, SCHEMA))
    if str(content["schema"]).startswith("ground/") and "/mapping/" not in str(content["schema"]):
        raise GroundError("%s: not a mapping: its schema is %s, not %s" % (path, content["schema"], SCHEMA))
    try:
        root = _plain(content)
        _check(root)
        return replace(_mapping(path, **root), undecided=tuple(_undecided(path, text)))
    except ValueError as error:
        raise GroundError("%s: %s" % (path, error))


def _undecided(path: str, text: str) -> Iterator[str]:
    """Warnings of the lines that a draft marks as guesses."""
    warning = "%s, line %d is a guess: %s; decide it, then delete the remark"
    for number, line in enumerate(text.splitlines(), 1):
        if UNDECIDED in line.partition("#")[2]:
            yield warning % (path, number, line.strip())


def _plain(value: Any, keys: Tuple[str, ...] = ()) -> Any:
    """A document without empty sections. YAML takes a plain `off` for false, which is the name of a key."""
    if isinstance(value, dict):
        named = {"off" if key is False else str(key): inner for key, inner in value.items()}
        for key in named if len(keys) > 1 else ():
            if named[key] is None:
                raise ValueError("%s has no value: add one" % ".".join((*keys, key)))
        return {k: _plain(inner, (*keys, k)) for k, inner in named.items() if inner is not None}
    if isinstance(value, float) and not math.isfinite(value):
        raise ValueError("%s is not a finite number" % value)
    return [_plain(inner, keys) for inner in value] if isinstance(value, list) else value


def _check(root: Any) -> None:
    """ValueError where a document is not of the schema in mapping.schema.json. There `error` speaks of the
    key, and `sentence` has the key in it; both are clearer than what jsonschema says."""
    import jsonschema

    with open(os.path.join(os.path.dirname(__file__), "mapping.schema.json"), encoding="utf-8") as file:
        validator = jsonschema.Draft7Validator(json.load(file))
    errors = sorted(validator.iter_errors(root), key=lambda one: ("sentence" in one.schema, len(one.path)))
    if not errors:
        return
    error = errors[0]
    key, what, wrong = ".".join(map(str, error.absolute_path)), error.message[:200], repr(error.instance)
    if "sentence" in error.schema:
        raise ValueError(error.schema["sentence"] % key)
    if error.validator == "additionalProperties":
        what = _unknown(error.instance, error.schema["properties"])
    if "error" in error.schema:
        what = error.schema["error"] + (", not %s" % wrong if len(wrong) < 50 else "")
    raise ValueError("%s: %s" % (key or "a key", what))


def _unknown(section: Iterable[str], known: Iterable[str]) -> str:
    """The first key of a section that is not known, with the nearest one that is."""
    key = next(key for key in section if key not in known)
    return "unknown key %s%s; allowed are %s" % (key, did_you_mean(key, known), ", ".join(known))


def _mapping(path: str, schema: str, **keys: Any) -> FieldMapping:
    """The FieldMapping that the keys of a document say, which is of the schema; ValueError for values that do
    not fit each other."""
    poses = _poses(**keys.pop("poses", {}))
    rows, stamps, folder = keys.get("rows", [1, 2]), keys.pop("stamps", None), os.path.dirname(path)
    if not rows[0] < rows[1]:
        raise ValueError("rows is %s, but must be the first and the last row, from 1" % rows)
    found = _filled(
        FieldMapping,
        poses=poses,
        commands=_commands(**keys.pop("commands", {})),
        inertial=_filled(Sensors, **keys.pop("inertial", {})),
        battery=_filled(Battery, **keys.pop("battery", {})),
        loads=[_filled(Load, **load) for load in keys.pop("payload", [])],
        types=[os.path.join(folder, os.path.expanduser(one)) for one in keys.pop("types", [])],
        file=path,
        sources={name: path for name in ("axes", "heading_offset") if getattr(poses, name) is not None},
        **keys,
    )
    return found if stamps is None else found._with_stamps(stamps)


def _filled(kind: Type[_T], **keys: Any) -> _T:
    """A dataclass of what keys of the same names say."""
    found = {name: tuple(value) if isinstance(value, list) else value for name, value in keys.items()}
    if "time" in keys:
        found["time"] = Clock(**keys["time"]) if isinstance(keys["time"], dict) else Clock(keys["time"])
    if "type" in keys:
        found["type"] = keys["type"].replace("/msg/", "/")
    return kind(**found)


def _poses(**keys: Any) -> Poses:
    for name, plain in NESTED.items():
        keys.update((plain[key], value) for key, value in keys.pop(name, {}).items())
    poses = _filled(Poses, **keys)
    if poses.axes is not None:
        try:
            _core.AxisMapping(poses.axes, 0.0)
        except ValueError as error:
            raise ValueError("poses.axes is not a frame: %s" % error)
    return poses


def _commands(**keys: Any) -> Commands:
    channels = [_channel(name, **given) for name, given in keys.pop("channels", {}).items()]
    names, lift = [channel.name for channel in channels], keys.get("lift", LIFT)
    if lift != LIFT and lift not in names:
        raise ValueError("commands.lift is %s, which is none of the channels: %s" % (lift, ", ".join(names)))
    if keys.get("empty") is False:  # YAML takes a plain off for false
        keys["empty"] = "off"
    return _filled(Commands, channels=channels, **keys)


def _channel(name: str, unit: str = "", **keys: Any) -> CommandChannel:
    off, full = COMMANDS[unit or "normalised"]
    is_given = bool(unit) or "off" in keys or "full" in keys
    said = {"name": name, "off": off, "full": full, **keys, "is_given": is_given}
    channel = _filled(CommandChannel, **said)
    if channel.off == channel.full:
        raise ValueError("commands.channels.%s.full is the same as off, %g" % (name, channel.off))
    if not channel.range[0] < channel.range[1]:
        text = "commands.channels.%s.range is %s, but must be two numbers in order"
        raise ValueError(text % (name, keys["range"]))
    return channel
