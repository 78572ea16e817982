"""print_recording.py BAG...: prints all that ground reads from each bag, as a line of JSON per bag.
test_wheel.py runs it with ROS and without."""

import dataclasses
import json
import sys

import numpy as np

from ground import _core
from ground.reading import bags, readers


def plain(value):
    """The value as JSON can hold it; numbers keep all their digits."""
    if dataclasses.is_dataclass(value):
        return {field.name: plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, _core.Payload):
        return {name: plain(getattr(value, name)) for name in ("mass", "place", "inertia")}
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    return value.hex() if isinstance(value, float) else value


for path in sys.argv[1:]:
    with bags.Bag(path) as bag:
        tables = {topic: bag.table(topic) for topic in sorted(bag.topics)}
    print(json.dumps([plain(readers.read(path)), plain(tables)]))
