"""Channels of a view: what each has, in which units, and how a message of it is written.

They are the same live and in MCAP files. Numbers are protobuf messages, which Foxglove, Lichtblick,
PlotJuggler and rerun read; the names of their fields end with the unit. Scenes, transforms and the log have
the schemas of Foxglove.
"""

import math
import re
import struct
from typing import Any, Callable, Dict, Iterable, List, NamedTuple, Sequence, Tuple

from ground.support.errors import GroundError

NANOSECONDS = 1e9  # in a second
PACKAGE = "ground"  # name of the package of the protobuf messages


class ChannelContent(NamedTuple):
    """What a channel has: fields of numbers with their units, of texts, and of flags."""

    about: str
    numbers: Tuple[str, ...] = ()
    texts: Tuple[str, ...] = ()
    flags: Tuple[str, ...] = ()


POSE = ("x_m", "y_m", "heading_deg")
MOTION = (*POSE, "u_m_s", "v_m_s", "r_deg_s")
STATUS = ("state", "reason")
MODELS = ("model", "model2")  # the first and the second model, in topics

PREDICTION = ChannelContent(
    "pose (world_ned) and velocity (body) that a model predicts; measured minus predicted pose",
    (*MOTION, "off_x_mm", "off_y_mm", "off_heading_deg", "off_mm", "ahead_s"),
    ("model",),
)
ACCURACY = ChannelContent(
    "rms error of the predictions, five times a second at most, and the noise floor",
    ("position_mm", "heading_deg", "position_noise_mm", "heading_noise_deg", "horizon_s"),
    ("model",),
    ("excited",),
)
MISSING = ChannelContent(
    "missing force and moment of a model (body), and their standard deviations",
    ("X_mN", "Y_mN", "N_mNm", "X_sigma_mN", "Y_sigma_mN", "N_sigma_mNm"),
    ("model",),
)
OF_MODEL = {"prediction": PREDICTION, "accuracy": ACCURACY, "missing": MISSING}
KINDS: Dict[str, ChannelContent] = {
    "/pose": ChannelContent("pose as the mocap measured it (world_ned)", POSE),
    "/state": ChannelContent(
        "state of the craft (pose world_ned, velocity body)", (*MOTION, "age_ms"), ("status",), ("valid",)
    ),
    "/reference": ChannelContent("where the craft should be (world_ned)", ("x_m", "y_m", "speed_m_s")),
    **{"/%s/%s" % (model, name): kind for model in MODELS for name, kind in OF_MODEL.items()},
    "/comparison": ChannelContent(
        "which of two models predicts better; 1 is what noise leaves",
        ("difference", "standard_error"),
        ("better",),
    ),
    "/controller": ChannelContent("state of the controller", ("elapsed_s",), STATUS),
    "/sender": ChannelContent(
        "state of the link to the craft",
        ("sent", "received", "malformed", "foreign", "refused"),
        (*STATUS, "peer"),
    ),
    "/discovery": ChannelContent(
        "state of a discovery",
        ("flight", "flown_s", "budget_s"),
        ("activity", "purpose", "verdict", "reason"),
        ("ended", "sure"),
    ),
}
# Channels whose fields depend on the craft or on what was considered
COMMANDS = {
    "/commands": "commands to the craft, by channel",
    "/commands/wanted": "commands before they were limited",
}
BELIEFS = "/beliefs"
ABOUT_BELIEFS = "probability that each effect acts and matters, 0 to 1"
# Channels of Foxglove's own schemas
SCENES = {
    "/tf": "frames world (z up), world_ned, hovercraft and, as predicted, model and model2",
    "/scene/room": "walls and home of the room",
    "/scene/craft": "craft, thrust and missing force",
    "/scene/paths": "measured path, reference, and what models predict",
    "/scene/floor": "how far the first model is off, over the floor",
    "/scene/legend": "what colours and arrows mean",
    "/log": "changes of state of controller and sender, and their reasons",
}

_FACTORS = (("deg", 180 / math.pi), ("mm", 1e3), ("ms", 1e3), ("mN", 1e3), ("mNm", 1e3))


def factor(field: str) -> float:
    """Factor from SI to the unit with which the name of a field ends."""
    end = field.rsplit("_", 2)[-2:]
    unit = end[0] if end[-1] == "s" and end[0] == "deg" else end[-1]
    return dict(_FACTORS).get(unit, 1.0)


def identifiers(names: Iterable[str]) -> Tuple[str, ...]:
    """Names as fields of protobuf can have them, which differ by more than case and underscores."""
    found: Dict[str, str] = {}
    for number, name in enumerate(names, 1):
        plain = re.sub(r"\W", "_", name, flags=re.ASCII)
        plain = plain if plain[:1].isalpha() else "input_" + plain
        while plain.replace("_", "").lower() in found:
            plain += "_%d" % number
        found[plain.replace("_", "").lower()] = plain
    return tuple(found.values())


def clean(text: str) -> str:
    """A text as every viewer can show it: valid Unicode without control characters but for line ends."""
    if text.isascii() and text.isprintable():
        return text
    valid = text.encode("utf-8", "replace").decode("utf-8")
    return "".join(c if c.isprintable() or c in "\n\t" else "\N{REPLACEMENT CHARACTER}" for c in valid)


class Numbers:
    """A channel of numbers, texts and flags.

    A value in SI is written in the unit of its field. Messages are encoded here: the library's objects take
    five times as long, and there are hundreds of messages a second.
    """

    def __init__(self, topic: str, kind: ChannelContent, context: Any) -> None:
        """context: of foxglove, that the channel belongs to."""
        doubles = [_tag(number, _FIXED64) for number in range(1, len(kind.numbers) + 1)]
        self._factors = [factor(name) for name in kind.numbers]
        self._row: List[Any] = [part for tag in doubles for part in (tag, 0.0)]
        self._pack = struct.Struct("<" + "".join("%dsd" % len(tag) for tag in doubles)).pack
        first = len(doubles) + 1
        self._texts = [_tag(first + i, _DELIMITED) for i in range(len(kind.texts))]
        self._flags = [_tag(first + len(self._texts) + i, _VARINT) for i in range(len(kind.flags))]
        self._written: Tuple[Sequence[str], bytes] = (), b""  # the last texts, and what they are written as
        types = ["double"] * len(kind.numbers) + ["string"] * len(kind.texts) + ["bool"] * len(kind.flags)
        _, schema = message_class(_title(topic), list(zip((*kind.numbers, *kind.texts, *kind.flags), types)))
        self.channel = channel(topic, kind.about, schema, context)

    def log(self, time: int, numbers: Sequence[float], texts: Sequence[str] = (), *flags: bool) -> None:
        """Writes a message. time: [ns]; numbers: in SI, in the order of the fields."""
        if not self.channel.has_sinks():
            return
        row = self._row
        row[1::2] = [value * by for value, by in zip(numbers, self._factors)]
        if texts != self._written[0]:
            encoded = [clean(text).encode() for text in texts]
            parts = [tag + _varint(len(text)) + text for tag, text in zip(self._texts, encoded)]
            self._written = texts, b"".join(parts)
        marks = b"".join(tag + (b"\1" if flag else b"\0") for tag, flag in zip(self._flags, flags))
        self.channel.log(self._pack(*row) + self._written[1] + marks, log_time=time)


_VARINT, _FIXED64, _DELIMITED = 0, 1, 2  # wire types of protobuf


def _tag(field: int, kind: int) -> bytes:
    """What stands before a value of protobuf."""
    return _varint(field << 3 | kind)


def _varint(value: int) -> bytes:
    """A whole number as protobuf writes it."""
    found = bytearray()
    while value > 127:
        found.append(value & 127 | 128)
        value >>= 7
    return bytes([*found, value])


class Beliefs:
    """The channel of the beliefs of a discovery."""

    def __init__(self, context: Any) -> None:
        self._fields = ("effect", "probability", "state")
        row = list(zip(self._fields, ("string", "double", "string")))
        self._write, schema = message_class("Beliefs", [("beliefs", row)])
        self.channel = channel(BELIEFS, ABOUT_BELIEFS, schema, context)

    def log(
        self, time: int, effects: Sequence[str], probabilities: Sequence[float], states: Sequence[str]
    ) -> None:
        """Writes a message. time: [ns]; an element of each sequence for every effect."""
        rows = zip(map(clean, effects), probabilities, map(clean, states))
        message = self._write(beliefs=[dict(zip(self._fields, row)) for row in rows])
        self.channel.log(message.SerializeToString(), log_time=time)


def _title(topic: str) -> str:
    return "".join(word.capitalize() for word in topic.split("/"))


def channel(topic: str, about: str, schema: Any, context: Any) -> Any:
    """A foxglove.Channel of protobuf messages."""
    import foxglove

    return foxglove.Channel(
        topic, schema=schema, message_encoding="protobuf", context=context, metadata={"about": about}
    )


def message_class(name: str, fields: Sequence[Tuple[str, Any]]) -> Tuple[Callable[..., Any], Any]:
    """Class of a protobuf message and its foxglove.Schema.

    fields: names and types; a list of fields instead of a type is a repeated message of these."""
    from foxglove import Schema

    try:
        from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
    except ImportError:
        raise GroundError("viewers need the Python module protobuf: apt install python3-protobuf")
    file = descriptor_pb2.FileDescriptorProto(name=name + ".proto", package=PACKAGE, syntax="proto3")
    described = file.message_type.add(name=name)
    kinds = descriptor_pb2.FieldDescriptorProto
    types = {"double": kinds.TYPE_DOUBLE, "string": kinds.TYPE_STRING, "bool": kinds.TYPE_BOOL}

    def add(message: Any, rows: Sequence[Tuple[str, Any]]) -> None:
        for number, (field, kind) in enumerate(rows, 1):
            if isinstance(kind, str):
                message.field.add(name=field, number=number, type=types[kind], label=kinds.LABEL_OPTIONAL)
                continue
            nested = message.nested_type.add(name="Row")
            add(nested, kind)
            label, of = kinds.LABEL_REPEATED, ".%s.%s.Row" % (PACKAGE, name)
            message.field.add(name=field, number=number, type=kinds.TYPE_MESSAGE, label=label, type_name=of)

    add(described, fields)
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    found = pool.FindMessageTypeByName("%s.%s" % (PACKAGE, name))
    if hasattr(message_factory, "GetMessageClass"):
        made = message_factory.GetMessageClass(found)
    else:  # before protobuf 4.22
        made = message_factory.MessageFactory(pool).GetPrototype(found)
    data = descriptor_pb2.FileDescriptorSet(file=[file]).SerializeToString()
    return made, Schema(name=found.full_name, encoding="protobuf", data=data)
