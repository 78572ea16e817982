"""What of a file becomes a recording: topics, fields, units, frames, channels and clocks.

A FieldMapping is the one place that says so, whether a mapping file (schema ground/mapping/1) or options
of the command line have it from. What it leaves open is found in the file, or has a default.
"""

import math
import re
from dataclasses import dataclass, field, replace
from typing import Any, Callable, Dict, Mapping, Optional, Tuple, TypeVar, Union

import numpy as np
import yaml

from ground import _core
from ground.support.annotations import Array
from ground.support.errors import GroundError, reason

_T = TypeVar("_T")
_D = TypeVar("_D")

SCHEMA = "ground/mapping/1"
LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254}  # [m]
ANGLES = {"rad": 1.0, "deg": math.pi / 180}  # [rad]
TIMES = {"s": 10**9, "ms": 10**6, "us": 10**3, "ns": 1}  # [ns]
# values of a command that mean off and full
COMMANDS = {"normalised": (0.0, 1.0), "percent": (0.0, 100.0), "microseconds": (1000.0, 2000.0)}
LIFT = "lift"  # default name of the channel that is no thruster
HEADER, RECEIPT = "header", "receipt"
RANGE = (0.0, 1.0)  # default range of a command
MAX_DRIFT = 0.1  # [s/s]
MAX_CHANNELS = 9  # eight thrusters and the lift fan
NAME = re.compile(r"[A-Za-z_]\w*")
LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


@dataclass(frozen=True)
class Clock:
    """Where the stamps of a topic are."""

    source: str = ""  #: HEADER, RECEIPT, or empty: the header where there is one
    field: str = ""  #: path of a field that is the time, in place of a source
    unit: str = "s"  #: unit of that field
    nanoseconds: str = ""  #: path of a field to add [ns]


@dataclass(frozen=True)
class Poses:
    """Where poses are, and what they are measured in."""

    topic: str = ""  #: empty: the only one that has poses
    file: str = ""  #: pattern of the names of tables that have them
    type: str = ""  #: type of the topic's messages; empty: any
    body: str = ""  #: child frame, or part of the topic's name
    position: Tuple[str, ...] = ()  #: paths of x, y, z or x, y, "-y" mirrors; empty: the type's
    unit: str = "m"
    scale: float = 1.0
    orientation: Tuple[str, ...] = ()  #: paths of the quaternion's x, y, z, w
    heading: str = ""  #: path of an angle in place of a quaternion
    heading_unit: str = "rad"
    heading_sign: int = 1  #: -1: it, or the quaternion's turn, is positive the other way round
    axes: Optional[str] = None
    heading_offset: Optional[float] = None  #: [rad]
    time: Clock = Clock()


@dataclass(frozen=True)
class Channel:
    """One command, from the value of a field."""

    name: str
    field: str
    off: float = 0.0  #: value that means 0
    full: float = 1.0  #: value that means 1
    scale: float = 1.0
    sign: int = 1
    range: Tuple[float, float] = RANGE

    def commands(self, values: Array) -> Array:
        """Normalised commands of a field's values."""
        factor = self.sign * self.scale / (self.full - self.off)
        return np.asarray((values - self.off) * factor)


@dataclass(frozen=True)
class Commands:
    """Where commands are, and what their values mean."""

    topic: str = ""  #: empty: the one named controls
    file: str = ""  #: pattern of the names of tables that have them
    type: str = ""
    channels: Tuple[Channel, ...] = ()  #: empty: left, right, lift as the type has them
    lift: str = LIFT  #: the channel of the lift fan
    time: Clock = Clock()


@dataclass(frozen=True)
class FieldMapping:
    """What of a file becomes a recording."""

    poses: Poses = Poses()
    commands: Commands = Commands()
    clock_offset: float = 0.0  #: added to the stamps of poses [s]
    clock_drift: float = 0.0  #: added to them for each second since the first pose [s/s]
    file: str = ""  #: that it was read from
    sources: Mapping[str, str] = field(default_factory=dict)  #: who gave axes and heading_offset

    def with_options(
        self,
        pose_topic: Optional[str] = None,
        command_topic: Optional[str] = None,
        body: Optional[str] = None,
        axes: Optional[str] = None,
        heading_offset: Optional[float] = None,
    ) -> "FieldMapping":
        """The same with what options say in its place; None leaves it as it is."""
        given = {"axes": axes, "heading_offset": heading_offset, "topic": pose_topic, "body": body}
        changed: Dict[str, Any] = {name: value for name, value in given.items() if value is not None}
        options = {n: "--" + n.replace("_", "-") for n in ("axes", "heading_offset") if n in changed}
        topic = self.commands.topic if command_topic is None else command_topic
        return replace(
            self,
            poses=replace(self.poses, **changed),
            commands=replace(self.commands, topic=topic),
            sources={**self.sources, **options},
        )

    @property
    def of_tables(self) -> bool:
        """Whether it says what tables need: which columns are the time."""
        return bool(self.poses.time.field and self.commands.time.field)


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
    root = _Node(path, "", content)
    schema = root.take("schema", _text, "")
    if not schema:
        raise GroundError("%s: not a mapping: write schema: %s" % (path, SCHEMA))
    if schema != SCHEMA:
        raise GroundError("%s: schema is '%s', but must be %s" % (path, schema, SCHEMA))
    poses, commands = _poses(root.child("poses")), _commands(root.child("commands"))
    offset = root.take("clock_offset", _number, 0.0)
    drift = root.take("clock_drift", _drift, 0.0)
    root.finish()
    given = {n: path for n in ("axes", "heading_offset") if getattr(poses, n) is not None}
    return FieldMapping(poses, commands, offset, drift, path, given)


def _number(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise ValueError("is %s, but must be a finite number" % value)
    return float(value)


def _factor(value: Any) -> float:
    if _number(value) == 0:
        raise ValueError("is 0")
    return float(value)


def _sign(value: Any) -> int:
    if _number(value) not in (1, -1):
        raise ValueError("is %g, but must be 1 or -1" % value)
    return int(value)


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise ValueError("is %s, but must be a string" % value)
    return value


def _one_of(*choices: str) -> Callable[[Any], str]:
    def check(value: Any) -> str:
        if _text(value) not in choices:
            raise ValueError("is '%s', but must be one of %s" % (value, ", ".join(choices)))
        return str(value)

    return check


def _fields(*counts: int) -> Callable[[Any], Tuple[str, ...]]:
    def check(value: Any) -> Tuple[str, ...]:
        if not isinstance(value, list) or not all(isinstance(v, str) and v for v in value):
            raise ValueError("must be a list of fields")
        if len(value) not in counts:
            raise ValueError("has %d fields, but needs %s" % (len(value), " or ".join(map(str, counts))))
        return tuple(value)

    return check


def _axes(value: Any) -> str:
    try:
        _core.AxisMapping(_text(value), 0.0)
    except ValueError as error:
        raise ValueError("is not a frame: %s" % error)
    return str(value)


def _drift(value: Any) -> float:
    if not abs(_number(value)) < MAX_DRIFT:
        raise ValueError("is %g, but must be within -%g and %g" % (value, MAX_DRIFT, MAX_DRIFT))
    return float(value)


def _range(value: Any) -> Tuple[float, float]:
    two = isinstance(value, list) and len(value) == 2 and all(type(v) in (int, float) for v in value)
    if not two or not -1 <= value[0] < value[1] <= 1:
        raise ValueError("is %s, but must be two numbers within -1 and 1" % value)
    return float(value[0]), float(value[1])


class _Node:
    """A table of a YAML file whose keys are taken one by one; name: its path in the file."""

    def __init__(self, file: str, name: str, content: Any) -> None:
        self.file, self.name = file, name
        if content is not None and not isinstance(content, dict):
            raise GroundError("%s: %s is not a table of keys" % (file, name or "the file"))
        # YAML takes a plain `off` for false.
        self.content = {"off" if key is False else key: v for key, v in (content or {}).items()}

    def wrong(self, key: str, what: object) -> GroundError:
        """The error for a key."""
        return GroundError("%s: %s %s" % (self.file, self._path(key), what))

    def _path(self, key: str) -> str:
        return "%s.%s" % (self.name, key) if self.name else key

    def child(self, key: str) -> "_Node":
        """The table of a key, empty where it is missing."""
        return _Node(self.file, self._path(key), self.content.pop(key, None))

    def take(self, key: str, check: Callable[[Any], _T], default: _D) -> Union[_T, _D]:
        """The value of a key, or a default where it is missing."""
        if key not in self.content:
            return default
        try:
            return check(self.content.pop(key))
        except ValueError as error:
            raise self.wrong(key, error)

    def apart(self, one: str, *others: str) -> None:
        """GroundError for keys that exclude each other."""
        if one in self.content and any(other in self.content for other in others):
            raise self.wrong(one, "and %s are both given; keep one" % " or ".join(others))

    def finish(self) -> None:
        """GroundError for a key that nothing has taken."""
        for key in self.content:
            raise self.wrong(str(key), "is unknown; the schema %s does not have it" % SCHEMA)


def _clock(node: _Node) -> Clock:
    """The value of key `time`."""
    if not isinstance(node.content.get("time"), dict):
        return Clock(node.take("time", _one_of("", HEADER, RECEIPT), ""))
    inner = node.child("time")
    unit = inner.take("unit", _one_of(*TIMES), "s")
    clock = Clock("", inner.take("field", _text, ""), unit, inner.take("nanoseconds", _text, ""))
    inner.finish()
    if not clock.field:
        raise node.wrong("time", "names no field")
    return clock


def _place(node: _Node) -> Dict[str, Any]:
    """Topic, file, type and time."""
    node.apart("file", "topic")
    found: Dict[str, Any] = {key: node.take(key, _text, "") for key in ("topic", "file", "type")}
    return dict(found, type=found["type"].replace("/msg/", "/"), time=_clock(node))


def _poses(node: _Node) -> Poses:
    node.apart("heading", "orientation")
    position, heading = node.child("position"), node.child("heading")
    poses = Poses(
        **_place(node),
        body=node.take("body", _text, ""),
        position=position.take("fields", _fields(2, 3), ()),
        unit=position.take("unit", _one_of(*LENGTHS), "m"),
        scale=position.take("scale", _factor, 1.0),
        orientation=node.take("orientation", _fields(4), ()),
        heading=heading.take("field", _text, ""),
        heading_unit=heading.take("unit", _one_of(*ANGLES), "rad"),
        heading_sign=heading.take("sign", _sign, 1),
        axes=node.take("axes", _axes, None),
        heading_offset=node.take("heading_offset", _number, None),
    )
    for inner in (position, heading, node):
        inner.finish()
    if poses.position and not (poses.orientation or poses.heading):
        raise node.wrong("position", "has fields, but neither orientation nor heading has any")
    return poses


def _commands(node: _Node) -> Commands:
    channels = node.child("channels")
    names = list(channels.content)
    if len(names) > MAX_CHANNELS:
        raise node.wrong("channels", "are %d, but there may be at most %d" % (len(names), MAX_CHANNELS))
    lift = node.take("lift", _text, LIFT)
    if lift != LIFT and lift not in names:
        raise node.wrong("lift", "is %s, which is none of the channels: %s" % (lift, ", ".join(names)))
    taken = tuple(_channel(channels.child(name), name) for name in names)
    found = Commands(**_place(node), channels=taken, lift=lift)
    node.finish()
    return found


def _channel(node: _Node, name: Any) -> Channel:
    if not isinstance(name, str) or not NAME.fullmatch(name):
        raise GroundError("%s: the channel '%s' is not a name: use letters, digits and _" % (node.file, name))
    node.apart("unit", "off", "full")
    off, full = COMMANDS[node.take("unit", _one_of(*COMMANDS), "normalised")]
    channel = Channel(
        name,
        node.take("field", _text, ""),
        node.take("off", _number, off),
        node.take("full", _number, full),
        node.take("scale", _factor, 1.0),
        node.take("sign", _sign, 1),
        node.take("range", _range, RANGE),
    )
    node.finish()
    if not channel.field:
        raise node.wrong("field", "is missing")
    if channel.off == channel.full:
        raise node.wrong("full", "is the same as off, %g" % channel.off)
    return channel
