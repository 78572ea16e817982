"""What turns bytes of a bag into messages and messages into bags: ROS where it is installed, else rosbags.

A codec is a module of this folder with these:

    NEEDS                             names of modules that it imports
    Time(seconds, nanoseconds)        has to_sec() and to_nsec(); so have all times in messages
    known(kind)                       the Kind of a message type that is installed; None without it
    defined(kind, definition)         the Kind of a type by the definition in a bag
    new(kind, **fields)               a message, its other fields empty or 0
    bag_writer(path)                  a context manager, write(topic, message, Time), of a new bag
    unpack_lz4(frame)                 the contents of an LZ4 frame; raises when its checksum is wrong

Message types are named as in bags, "ground_msgs/Controls". Both give the same values, bit by bit; an
array of numbers is a tuple or a NumPy array.
"""

import functools
import importlib
import importlib.util
from dataclasses import dataclass
from typing import Any, Callable, Iterable

from ground.errors import GroundError

CODECS = ("with_ros", "with_rosbags")  # the first one that finds what it needs is taken


@dataclass(frozen=True)
class Kind:
    """A message type as a codec knows it."""

    md5sum: str
    decode: Callable[[bytes], Any]  # raises anything on bytes that are no such message


@functools.lru_cache(maxsize=None)
def installed(names: Iterable[str] = CODECS) -> Any:
    """The codec of this computer. GroundError when there is none."""
    for name in names:
        codec = importlib.import_module("%s.%s" % (__name__, name))
        if all(importlib.util.find_spec(module) for module in codec.NEEDS):
            return codec
    raise GroundError("bags take the Python modules of ROS, or rosbags: pip install rosbags")
