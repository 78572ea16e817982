"""What of a file becomes a recording: topics, fields, units, frames, channels and clocks.

A FieldMapping is the one place that says so, whether a mapping file (schema ground/mapping/1) or options
of the command line have it from. What it leaves open is found in the file, or has a default.
"""

import math
import re
from dataclasses import dataclass, field, replace
from typing import Any, Dict, List, Mapping, Optional, Sequence, Tuple

import numpy as np
import yaml

from ground import _core
from ground.annotations import Array
from ground.errors import GroundError, reason

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
        given: Dict[str, Any] = {
            "topic": pose_topic,
            "body": body,
            "axes": axes,
            "heading_offset": heading_offset,
        }
        changed = {name: value for name, value in given.items() if value is not None}
        options = {n: "--" + n.replace("_", "-") for n in ("axes", "heading_offset") if n in changed}
        commands = self.commands
        if command_topic is not None:
            commands = replace(commands, topic=command_topic)
        return replace(
            self,
            poses=replace(self.poses, **changed),
            commands=commands,
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
    schema = root.text("schema")
    if schema != SCHEMA:
        raise GroundError(
            "%s: schema is '%s', but must be %s" % (path, schema, SCHEMA)
            if schema
            else "%s: not a mapping: write schema: %s" % (path, SCHEMA)
        )
    poses, commands = _poses(root.child("poses")), _commands(root.child("commands"))
    offset, drift = root.number("clock_offset", 0.0), root.number("clock_drift", 0.0)
    if not abs(drift) < MAX_DRIFT:
        raise root.wrong("clock_drift", "is %g, but must be within -%g and %g" % (drift, *[MAX_DRIFT] * 2))
    root.finish()
    given = {n: path for n in ("axes", "heading_offset") if getattr(poses, n) is not None}
    return FieldMapping(poses, commands, offset, drift, path, given)


class _Node:
    """A table of a YAML file whose keys are taken one by one."""

    def __init__(self, file: str, name: str, content: Any) -> None:
        self.file, self.name = file, name
        if content is None:
            content = {}
        if not isinstance(content, dict):
            raise GroundError("%s: %s is not a table of keys" % (file, name or "the file"))
        # YAML takes a plain `off` for false.
        self.content = {"off" if key is False else key: value for key, value in content.items()}

    def path(self, key: str) -> str:
        """Name of a key from the top of the file."""
        return "%s.%s" % (self.name, key) if self.name else key

    def wrong(self, key: str, what: str) -> GroundError:
        """The error for a key."""
        return GroundError("%s: %s %s" % (self.file, self.path(key), what))

    def child(self, key: str) -> "_Node":
        """The table of a key, empty where it is missing."""
        return _Node(self.file, self.path(key), self.content.pop(key, None))

    def has(self, key: str) -> bool:
        """Whether a key is there that has not been taken."""
        return key in self.content

    def text(self, key: str, default: str = "") -> str:
        """A string."""
        value = self.content.pop(key, default)
        if not isinstance(value, str):
            raise self.wrong(key, "is %s, but must be a string" % value)
        return value

    def choice(self, key: str, default: str, choices: Sequence[str]) -> str:
        """One of some strings."""
        value = self.text(key, default)
        if value not in choices:
            raise self.wrong(key, "is '%s', but must be one of %s" % (value, ", ".join(choices)))
        return value

    def number(self, key: str, default: float) -> float:
        """A finite number."""
        value = self.content.pop(key, default)
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
            raise self.wrong(key, "is %s, but must be a finite number" % value)
        return float(value)

    def sign(self, key: str) -> int:
        """1 or -1."""
        value = self.number(key, 1)
        if value not in (1, -1):
            raise self.wrong(key, "is %g, but must be 1 or -1" % value)
        return int(value)

    def fields(self, key: str, counts: Sequence[int]) -> Tuple[str, ...]:
        """Names of so many fields."""
        value = self.content.pop(key, None)
        if value is None:
            return ()
        if not isinstance(value, list) or not all(isinstance(v, str) and v for v in value):
            raise self.wrong(key, "must be a list of fields")
        if len(value) not in counts:
            raise self.wrong(
                key, "has %d fields, but needs %s" % (len(value), " or ".join(map(str, counts)))
            )
        return tuple(value)

    def finish(self) -> None:
        """GroundError for a key that nothing has taken."""
        for key in self.content:
            raise self.wrong(str(key), "is unknown; the schema %s does not have it" % SCHEMA)


def _clock(node: _Node) -> Clock:
    """The value of key `time`."""
    value = node.content.get("time")
    if not isinstance(value, dict):
        return Clock(node.choice("time", "", ("", HEADER, RECEIPT)))
    inner = node.child("time")
    clock = Clock(
        "",
        inner.text("field"),
        inner.choice("unit", "s", list(TIMES)),
        inner.text("nanoseconds"),
    )
    inner.finish()
    if not clock.field:
        raise node.wrong("time", "names no field")
    return clock


def _place(node: _Node) -> Tuple[str, str, str]:
    """Topic, file and type."""
    topic, file = node.text("topic"), node.text("file")
    if topic and file:
        raise node.wrong("file", "and topic are both given; keep one")
    return topic, file, node.text("type").replace("/msg/", "/")


def _poses(node: _Node) -> Poses:
    topic, file, kind = _place(node)
    position = node.child("position")
    orientation = node.fields("orientation", (4,))
    heading = node.child("heading")
    axes = node.text("axes") if node.has("axes") else None
    poses = Poses(
        topic,
        file,
        kind,
        node.text("body"),
        position.fields("fields", (2, 3)),
        position.choice("unit", "m", list(LENGTHS)),
        position.number("scale", 1.0),
        orientation,
        heading.text("field"),
        heading.choice("unit", "rad", list(ANGLES)),
        heading.sign("sign"),
        axes,
        node.number("heading_offset", 0.0) if node.has("heading_offset") else None,
        _clock(node),
    )
    for inner in (position, heading, node):
        inner.finish()
    if poses.scale == 0:
        raise position.wrong("scale", "is 0")
    if poses.orientation and poses.heading:
        raise node.wrong("heading", "and orientation are both given; keep one")
    if poses.position and not (poses.orientation or poses.heading):
        raise node.wrong("position", "has fields, but neither orientation nor heading has any")
    if axes is not None:
        try:
            _core.AxisMapping(axes, 0.0)
        except ValueError as error:
            raise node.wrong("axes", "is not a frame: %s" % error)
    return poses


def _commands(node: _Node) -> Commands:
    topic, file, kind = _place(node)
    channels = node.child("channels")
    names = list(channels.content)
    if len(names) > MAX_CHANNELS:
        raise node.wrong("channels", "are %d, but there may be at most %d" % (len(names), MAX_CHANNELS))
    lift = node.text("lift", LIFT)
    if lift != LIFT and lift not in names:
        raise node.wrong("lift", "is %s, which is none of the channels: %s" % (lift, ", ".join(names)))
    found = Commands(
        topic,
        file,
        kind,
        tuple(_channel(channels.child(name), name) for name in names),
        lift,
        _clock(node),
    )
    node.finish()
    return found


def _channel(node: _Node, name: Any) -> Channel:
    if not isinstance(name, str) or not NAME.fullmatch(name):
        raise GroundError(
            "%s: the channel '%s' is not a name: use letters, digits and _" % (node.file, name)
        )
    if node.has("unit") and (node.has("off") or node.has("full")):
        raise node.wrong("unit", "and off or full are both given; keep one")
    off, full = COMMANDS[node.choice("unit", "normalised", list(COMMANDS))]
    off, full = node.number("off", off), node.number("full", full)
    if off == full:
        raise node.wrong("full", "is the same as off, %g" % off)
    channel = Channel(
        name,
        node.text("field"),
        off,
        full,
        node.number("scale", 1.0),
        node.sign("sign"),
        _range(node),
    )
    node.finish()
    if not channel.field:
        raise node.wrong("field", "is missing")
    if channel.scale == 0:
        raise node.wrong("scale", "is 0")
    return channel


def _range(node: _Node) -> Tuple[float, float]:
    value: List[Any] = node.content.pop("range", list(RANGE))
    numbers = isinstance(value, list) and all(
        isinstance(v, (int, float)) and not isinstance(v, bool) for v in value
    )
    if not numbers or len(value) != 2 or not -1 <= value[0] < value[1] <= 1:
        raise node.wrong("range", "is %s, but must be two numbers within -1 and 1" % value)
    return float(value[0]), float(value[1])
