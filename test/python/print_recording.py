"""print_recording.py BAG...: prints all that ground reads from each bag, as a line of JSON per bag.
test_wheel.py runs it with ROS and without."""

import dataclasses
import json
import sys

import numpy as np

from ground.recordings import codecs, readers
from ground.recordings.bag_reader import BagReader


def plain(value):
    """The value as JSON can hold it; numbers keep all their digits."""
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
