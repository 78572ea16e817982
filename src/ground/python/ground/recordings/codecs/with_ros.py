"""The codec of ROS: genpy, rosbag and the installed message packages."""

from typing import Any, Optional, Sequence, Tuple

from ground.annotations import Message
from ground.annotations import Time as TimeOfRos
from ground.recordings import codecs
from ground.recordings.topics import CHUNK

NEEDS = ("genpy", "rosbag", "roslib", "roslz4", "ground_msgs")


def Time(seconds: int, nanoseconds: int) -> TimeOfRos:
    """See codecs.Codec."""
    import genpy

    return genpy.Time(seconds, nanoseconds)


def _class(kind: str) -> Any:
    import roslib.message

    try:
        return roslib.message.get_message_class(kind)
    except Exception:  # raised for unknown types
        return None


def _kind(message_class: Any) -> codecs.Kind:
    def decode(data: bytes) -> Message:
        message = message_class()
        message.deserialize(data)
        return message

    return codecs.Kind(message_class._md5sum, decode, fields)


def known(kind: str) -> Optional[codecs.Kind]:
    """See codecs.Codec."""
    found = _class(kind)
    return None if found is None else _kind(found)


def fields(kind: str) -> Optional[Sequence[Tuple[str, str]]]:
    """See codecs.Codec."""
    found = _class(kind)
    return None if found is None else list(zip(found.__slots__, found._slot_types))


def new(kind: str, **fields: Any) -> Message:
    """See codecs.Codec."""
    message = _class(kind)()
    for name, value in fields.items():
        setattr(message, name, value)
    return message


def bag_writer(path: str) -> Any:
    """See codecs.Codec."""
    import rosbag

    return rosbag.Bag(path, "w", compression="lz4", chunk_threshold=CHUNK)


def unpack_lz4(frame: bytes) -> Any:
    """See codecs.Codec."""
    import roslz4

    return roslz4.decompress(frame)
