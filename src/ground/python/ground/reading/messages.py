"""Messages of ground's own topics, and the bags of ROS 1 that they are written to, by rosbags."""

import contextlib
import functools
import glob
import os
from dataclasses import dataclass, field
from typing import Any, Dict, Iterator, Mapping

import numpy as np

from ground.reading.containers import FURTHER, SUFFIXES
from ground.support.annotations import Message
from ground.support.errors import GroundError

# Topics of the bags that launch/record.launch records
POSE = "/vrpn_client_node/hovercraft/pose"
SETTINGS = "/mocap_state/settings"
RUN_SETTINGS = "/run/settings"
CONTROLS = "/controls"
SENT = "/sent"
WANTED = "/controls/wanted"
DECISION = "/decision"
DRIVE = "/drive"
BURSTS = "/bursts"
TRUTH = "/simulator/truth"
TELEMETRY = "/sender/telemetry"
REFERENCE = "/reference"
REFERENCE_PATH = "/path/reference"
CONTROLLER = "/controller"  # name of its node
CHUNK = 8 * 1024  # size of a bag's chunks, as in launch/record.launch; a cut loses at most one [bytes]
TIME = "builtin_interfaces/msg/Time"


def time(nanoseconds: int) -> Any:
    """A time of messages."""
    seconds, rest = divmod(nanoseconds, 10**9)
    return _store().types[TIME](sec=seconds, nanosec=rest)


def new(kind: str, **fields: Any) -> Message:
    """A message of a type such as "ground_msgs/Controls"; fields that are not given are empty or 0."""
    plain = {
        name: np.ascontiguousarray(value) if isinstance(value, np.ndarray) else value
        for name, value in fields.items()
    }
    return _new("/msg/".join(kind.split("/")), plain)


@functools.lru_cache(maxsize=None)
def _store() -> Any:
    """rosbags' Typestore of ROS 1 with ground's messages, from the wheel or else from the ROS package."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    texts: Dict[str, str] = {}
    for path in glob.glob(os.path.join(os.path.dirname(os.path.dirname(__file__)), "msg", "*.msg")):
        with open(path) as file:
            texts[os.path.splitext(os.path.basename(path))[0]] = file.read()
    if not texts:
        import ground_msgs.msg as own

        every = {name: getattr(kind, "_full_text", "") for name, kind in vars(own).items()}
        texts = {name: text.split("=" * 80)[0] for name, text in every.items() if text}
    types: Dict[str, object] = {}
    for name, text in texts.items():
        types.update(get_types_from_msg(text, "ground_msgs/msg/" + name))
    store = get_typestore(Stores.ROS1_NOETIC)
    store.register(types)
    return store


def _new(name: str, fields: Mapping[str, object]) -> Message:
    definition = _store().get_msgdef(name)
    return definition.cls(**{**{n: _empty(*of) for n, of in definition.fields}, **fields})


def _empty(node: Any, of: Any) -> Any:
    """Default value of a field; node, of: rosbags' description of its type."""
    if node == 2:
        return time(0) if of == TIME else _new(of, {})
    if node == 1:
        return {"string": "", "bool": False}.get(of[0], 0)
    inner, count = of
    is_number = inner[0] == 1 and inner[1][0] != "string"
    values = [_empty(*inner) for _ in range(count if node == 3 else 0)]
    return np.array(values, inner[1][0]) if is_number else values


@dataclass
class _Bag:
    """A bag that is being written."""

    writer: Any
    connections: Dict[str, object] = field(default_factory=dict)  # by topic

    def write(self, topic: str, message: Message, received: int) -> None:
        """Adds a message that was received at a time [ns]."""
        store, name = _store(), message.__msgtype__
        if topic not in self.connections:
            definition, md5sum = store.generate_msgdef(name)
            self.connections[topic] = self.writer.add_connection(
                topic, name, msgdef=definition, md5sum=md5sum
            )
        self.writer.write(self.connections[topic], received, store.serialize_ros1(message, name))


def refuse_other_format(path: str) -> None:
    """GroundError where the name of a new bag ends as the names of other recordings do."""
    stem, end = os.path.splitext(path)
    if end.lower() in (".mcap", ".db3", *SUFFIXES, *FURTHER):
        text = "%s: what is written is a ROS 1 bag: name it %s.bag%s"
        table = "; in Python, ground.read(BAG)[0].to_frame() is a table of it"
        raise GroundError(text % (path, stem, table if end.lower() in SUFFIXES else ""))


@contextlib.contextmanager
def bag_writer(path: str) -> Iterator[_Bag]:
    """A new bag, which replaces the file at `path`."""
    import lz4.frame
    from rosbags.rosbag1 import Writer

    with contextlib.suppress(FileNotFoundError):
        os.unlink(path)  # rosbags writes new files only
    writer = Writer(path)
    writer.set_compression(Writer.CompressionFormat.LZ4)
    # With a checksum and without the size, as rosbag writes and reads it.
    writer.compressor = functools.partial(
        lz4.frame.compress, content_checksum=True, store_size=False, block_linked=False
    )
    writer.chunk_threshold = CHUNK
    with writer:
        yield _Bag(writer)
