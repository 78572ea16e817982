"""CSV files written by rostopic echo -p, and the bag that a pair of them becomes."""

import os
from typing import Dict, Optional, Tuple

import numpy as np

from ground.recordings import containers, messages
from ground.recordings.recording import checked
from ground.support import files
from ground.support.annotations import Array, Indices
from ground.support.errors import GroundError
from ground.support.progress import Work

RECEIVED = "%time"
STAMP = "field.header.stamp"
POINT = ["field.point.x", "field.point.y", "field.point.z"]
LATEST = 2**32 * 10**9  # ROS has 32 bits for seconds [ns]


def read_csv(path: str) -> Tuple[Indices, Indices, Array]:
    """Stamps, times of receipt [ns] and points (n, 3) of a `rostopic echo -p` export."""
    with containers.Tables([path]) as tables:
        columns = tables.table(os.path.basename(path))
    names = (STAMP, RECEIVED, *POINT)
    columns = {name: c for name in names for c in [containers.column(columns, name)] if c is not None}
    missing = [name for name in (STAMP, *POINT) if name not in columns]
    if missing:
        raise GroundError("%s, line 1: no column %s" % (path, ", ".join(missing)))
    if len(columns[STAMP]) < 2:
        raise GroundError("%s: only %d rows" % (path, len(columns[STAMP])))
    received = RECEIVED if RECEIVED in columns else STAMP
    numbers = containers.values(columns, [STAMP, received, *POINT], path)
    steps = np.diff(numbers[:, 0], prepend=numbers[:1, 0])
    outside = ~((numbers[:, :2] > 0) & (numbers[:, :2] < LATEST)).all(axis=1)
    for wrong, what in (
        (~np.isfinite(numbers).all(axis=1), "a value is missing, not a number or not finite"),
        (outside, "a stamp is not a time between 1970 and 2106 in nanoseconds"),
        (steps < 0, "the stamp is before that of the row above"),
    ):
        if wrong.any():
            raise GroundError("%s, line %d: %s" % (path, np.argmax(wrong) + 2, what))
    # as whole numbers, which have more digits than those of a float
    stamps, receipts = (np.asarray(columns[name]).astype(np.int64) for name in (STAMP, received))
    return stamps, receipts, numbers[:, 2:]


def write_bag(
    controls_path: str, pose_path: str, bag_path: str, force: bool = False, work: Optional[Work] = None
) -> Dict[str, int]:
    """Writes a pair of CSV exports to a bag; returns the number of messages by topic. work: told of
    what is read and written."""
    told, series = work or Work(), {}
    with told.stage("reading tables", 2):
        for topic, path in told.each((("pose", pose_path), ("controls", controls_path))):
            series[topic] = read_csv(path)
    both = "%s and %s" % (controls_path, pose_path)
    rows = {t: np.column_stack([containers.seconds(s), points]) for t, (s, _, points) in series.items()}
    checked(both, rows["pose"], rows["controls"], "", [])
    begins, ends = zip(*((min(r), max(r)) for _, r, _ in series.values()))
    if max(begins) > min(ends):
        raise GroundError("%s do not overlap in time: they are from different runs" % both)
    with files.new_file(bag_path, force) as temporary:
        with messages.bag_writer(temporary) as bag, told.stage("writing topics", len(series)):
            for topic, (stamps, received, points) in told.each(series.items()):
                for number, (stamp, receipt, point) in enumerate(zip(stamps, received, points.tolist())):
                    message = messages.new("geometry_msgs/PointStamped")
                    message.header.seq = number
                    message.header.stamp = messages.time(int(stamp))
                    message.point.x, message.point.y, message.point.z = point
                    bag.write(topic, message, int(receipt))
    return {topic: len(stamps) for topic, (stamps, _, _) in series.items()}
