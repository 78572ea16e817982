"""The codec of rosbags (PyPI), which is pure Python and knows the common messages of ROS 1."""

import contextlib
import functools
import glob
import os
from dataclasses import dataclass, field
from typing import Any, Dict, Iterator, Mapping, Optional, Sequence, Tuple

import numpy as np

import ground
from ground.annotations import Message
from ground.recordings import codecs
from ground.recordings.topics import CHUNK

NEEDS = ("rosbags", "lz4")
PACKAGES = ("std_msgs", "geometry_msgs", "nav_msgs")  # packages whose types rosbags has
TIME, DURATION = "builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration"
# Definitions of ROS 1. rosbags has those of ROS 2, where seconds are signed.
BUILTIN = {TIME: "uint32 sec\nuint32 nanosec\n", DURATION: "int32 sec\nint32 nanosec\n"}


@dataclass
class Time:
    """A time in a message; it replaces rosbags' class."""

    sec: int = 0
    nanosec: int = 0

    def to_sec(self) -> float:
        """In seconds."""
        return float(self.sec) + float(self.nanosec) / 1e9

    def to_nsec(self) -> int:
        """In nanoseconds."""
        return self.sec * 10**9 + self.nanosec


def _name(kind: str) -> str:
    """Name of a type such as "ground_msgs/Controls" in rosbags."""
    return "/msg/".join(kind.split("/"))


@functools.lru_cache(maxsize=None)
def _installed() -> Any:
    """The Typestore of ground's messages, which are in the wheel, and of those that they contain."""
    from rosbags.typesys import get_types_from_msg
    from rosbags.typesys.store import Typestore
    from rosbags.typesys.stores import ros1_noetic

    definitions = {
        name: fields
        for name, fields in ros1_noetic.FIELDDEFS.items()
        if name.split("/")[0] in PACKAGES
    }
    for path in glob.glob(os.path.join(os.path.dirname(ground.__file__), "msg", "*.msg")):
        name = "ground_msgs/msg/" + os.path.splitext(os.path.basename(path))[0]
        with open(path) as file:
            definitions.update(get_types_from_msg(file.read(), name))
    for name, text in BUILTIN.items():
        definitions.update(get_types_from_msg(text, name))
    store = Typestore()
    store.register(definitions)
    store.types[TIME] = Time
    return store


def known(kind: str) -> Optional[codecs.Kind]:
    """See codecs.Codec."""
    store, name = _installed(), _name(kind)
    if name not in store.types:
        return None
    md5sum = store.generate_msgdef(name)[1]
    return codecs.Kind(md5sum, lambda data: store.deserialize_ros1(data, name), fields)


def fields(kind: str) -> Optional[Sequence[Tuple[str, str]]]:
    """See codecs.Codec."""
    store = _installed()
    if _name(kind) not in store.types:
        return None
    definition = store.get_msgdef(_name(kind))
    return [(name, type_name(*of)) for name, of in definition.fields]


def type_name(node: Any, of: Any) -> str:
    """Name of the type of a field; node, of: rosbags' description of it."""
    from rosbags.interfaces import Nodetype

    if node == Nodetype.NAME:
        known = {TIME: "time", DURATION: "duration"}
        return known.get(of) or str(of).replace("/msg/", "/")
    if node == Nodetype.BASE:
        return str(of[0])
    inner, count = of
    return "%s[%s]" % (type_name(*inner), count if node == Nodetype.ARRAY else "")


def new(kind: str, **fields: Any) -> Message:
    """See codecs.Codec."""
    plain = {
        name: np.ascontiguousarray(value) if isinstance(value, np.ndarray) else value
        for name, value in fields.items()
    }
    return _new(_name(kind), plain)


def _new(name: str, fields: Mapping[str, Any]) -> Message:
    definition = _installed().get_msgdef(name)
    return definition.cls(**{**{n: _empty(*of) for n, of in definition.fields}, **fields})


def _empty(node: Any, of: Any) -> Any:
    """Default value of a field; node, of: rosbags' description of its type."""
    from rosbags.interfaces import Nodetype

    if node == Nodetype.NAME:
        return Time() if of == TIME else _new(of, {})
    if node == Nodetype.BASE:
        return {"string": "", "bool": False}.get(of[0], 0)
    inner, count = of
    if node == Nodetype.SEQUENCE:
        numbers = inner[0] == Nodetype.BASE and inner[1][0] != "string"
        return np.empty(0, inner[1][0]) if numbers else []
    values = [_empty(*inner) for _ in range(count)]
    return np.array(values, inner[1][0]) if inner[0] == Nodetype.BASE else values


@dataclass
class _Bag:
    """A bag that is being written."""

    writer: Any
    connections: Dict[str, Any] = field(default_factory=dict)  # by topic

    def write(self, topic: str, message: Message, time: Time) -> None:
        """Adds a message that was received at `time`."""
        store, name = _installed(), message.__msgtype__
        if topic not in self.connections:
            definition, md5sum = store.generate_msgdef(name)
            self.connections[topic] = self.writer.add_connection(
                topic, name, msgdef=definition, md5sum=md5sum
            )
        data = store.serialize_ros1(message, name)
        self.writer.write(self.connections[topic], time.to_nsec(), data)


@contextlib.contextmanager
def bag_writer(path: str) -> Iterator[_Bag]:
    """See codecs.Codec."""
    import lz4.frame
    from rosbags.rosbag1 import Writer

    with contextlib.suppress(FileNotFoundError):
        os.unlink(path)  # rosbags writes new files only
    writer = Writer(path)
    writer.set_compression(Writer.CompressionFormat.LZ4)
    # With a checksum, as rosbag writes it and rosbags does not, so that damage can be detected.
    writer.compressor = functools.partial(
        lz4.frame.compress, content_checksum=True, store_size=False, block_linked=False
    )
    writer.chunk_threshold = CHUNK
    with writer:
        yield _Bag(writer)


def unpack_lz4(frame: bytes) -> Any:
    """See codecs.Codec."""
    import lz4.frame

    return lz4.frame.decompress(frame)
