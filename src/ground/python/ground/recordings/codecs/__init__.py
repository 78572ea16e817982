"""Codecs decode messages from bags and write bags: by ROS where it is installed, else by rosbags.

A codec is a module of this folder, see Codec. Both give the same values, bit by bit; an array of
numbers is a tuple or a NumPy array.
"""

import functools
import importlib
import importlib.util
from dataclasses import dataclass
from typing import Any, Callable, ContextManager, Iterable, Optional, Protocol, Sequence, Tuple, cast

from ground.annotations import Message, Time
from ground.errors import GroundError

Decode = Callable[[bytes], Message]  # may raise anything on bytes of another type
# Names and types of the fields of a type, as definitions have them: "float64", "uint8[]",
# "std_msgs/Header"; None for types that are not known.
Fields = Callable[[str], Optional[Sequence[Tuple[str, str]]]]

CODECS = ("with_ros", "with_rosbags")  # the first one whose modules are installed is used


@dataclass(frozen=True)
class Kind:
    """A message type."""

    md5sum: str
    decode: Decode
    fields: Fields  #: of it and of the types that it contains


class Codec(Protocol):
    """Interface of a codec. Message types are named as in bags, "ground_msgs/Controls"."""

    NEEDS: Tuple[str, ...]  #: names of modules that it imports

    def Time(self, seconds: int, nanoseconds: int) -> Time:
        """A time with to_sec() and to_nsec(), which all times in messages have."""

    def known(self, kind: str) -> Optional[Kind]:
        """The Kind of a message type that is installed; None without it."""

    def fields(self, kind: str) -> Optional[Sequence[Tuple[str, str]]]:
        """See Fields; of types that are installed."""

    def new(self, kind: str, **fields: Any) -> Message:
        """A message, its other fields empty or 0."""

    def bag_writer(self, path: str) -> ContextManager[Any]:
        """Writer of a new bag, with write(topic, message, time of receipt)."""

    def unpack_lz4(self, frame: bytes) -> bytes:
        """The contents of an LZ4 frame; raises when its checksum is wrong."""


@functools.lru_cache(maxsize=None)
def installed(names: Iterable[str] = CODECS) -> Codec:
    """The codec of this computer. GroundError when there is none."""
    for name in names:
        codec = importlib.import_module("%s.%s" % (__name__, name))
        if all(importlib.util.find_spec(module) for module in codec.NEEDS):
            return cast(Codec, codec)
    raise GroundError("bags need the Python modules of ROS, or rosbags: pip install rosbags")
