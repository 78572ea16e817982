"""print_recording.py BAG...: what ground reads from each bag, every bit of it, a line of JSON for a bag.
Run with ROS and without, for test_wheel.py."""

import dataclasses
import json
import sys

import numpy as np

from ground.recordings import codecs, readers
from ground.recordings.bag_reader import BagReader


def plain(value):
    """As JSON; numbers with all their digits."""
    if hasattr(value, "to_nsec"):
        return value.to_nsec()
    if dataclasses.is_dataclass(value):
        names = [f.name for f in dataclasses.fields(value) if not f.name.startswith("_")]
        return {name: plain(getattr(value, name)) for name in names}
    if hasattr(value, "__slots__") and hasattr(value, "_type"):  # a message of genpy
        return {name: plain(getattr(value, name)) for name in value.__slots__}
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    return value.hex() if isinstance(value, float) else value


def messages(path):
    with BagReader(path) as bag:
        topics = list(bag.get_type_and_topic_info().topics)
        return [(t, plain(m), plain(r)) for t, m, r in bag.read_messages(topics)]


print(codecs.installed().__name__)
for path in sys.argv[1:]:
    print(json.dumps([plain(readers.read(path)), messages(path)]))
