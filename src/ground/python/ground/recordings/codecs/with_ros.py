"""The codec of ROS: genpy, rosbag and the installed message packages."""

from ground.recordings import codecs
from ground.recordings.topics import CHUNK

NEEDS = ("genpy", "rosbag", "roslib", "roslz4", "ground_msgs")


def Time(seconds, nanoseconds):
    import genpy

    return genpy.Time(seconds, nanoseconds)


def _class(kind):
    import roslib.message

    try:
        return roslib.message.get_message_class(kind)
    except Exception:  # of a name that is no type's
        return None


def _kind(message_class):
    def decode(data):
        message = message_class()
        message.deserialize(data)
        return message

    return codecs.Kind(message_class._md5sum, decode)


def known(kind):
    found = _class(kind)
    return None if found is None else _kind(found)


def defined(kind, definition):
    import genpy.dynamic

    return _kind(genpy.dynamic.generate_dynamic(kind, definition)[kind])


def new(kind, **fields):
    message = _class(kind)()
    for name, value in fields.items():
        setattr(message, name, value)
    return message


def bag_writer(path):
    import rosbag

    return rosbag.Bag(path, "w", compression="lz4", chunk_threshold=CHUNK)


def unpack_lz4(frame):
    import roslz4

    return roslz4.decompress(frame)
