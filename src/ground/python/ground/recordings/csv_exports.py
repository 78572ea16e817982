"""CSV files written by rostopic echo -p, and the bag that a pair of them becomes."""

import csv
import math
from typing import Dict, List, Optional, Tuple

import numpy as np

from ground import files
from ground.annotations import Array
from ground.errors import GroundError
from ground.progress import Work
from ground.recordings import codecs
from ground.recordings.recording import checked

CSV_RECEIVED = "%time"
LATEST = 2**32 * 10**9  # ROS has 32 bits for seconds [ns]
CSV_STAMP = "field.header.stamp"
CSV_COLUMNS = [CSV_STAMP, "field.point.x", "field.point.y", "field.point.z"]


def read_csv(path: str) -> Tuple[List[int], List[int], Array]:
    """Stamps, times of receipt [integer ns] and points (n, 3) of a `rostopic echo -p` export."""
    try:
        with open(path, newline="") as file:
            reader = csv.DictReader(file)
            missing = [c for c in CSV_COLUMNS if c not in (reader.fieldnames or [])]
            if missing:
                raise GroundError("%s, line 1: no column %s" % (path, ", ".join(missing)))
            stamps: List[int] = []
            received: List[int] = []
            points: List[List[float]] = []
            for row in reader:
                try:
                    stamp = int(row[CSV_STAMP])
                    receipt = int(row.get(CSV_RECEIVED) or stamp)
                    point = [float(row[c]) for c in CSV_COLUMNS[1:]]
                except (TypeError, ValueError):
                    raise GroundError(
                        "%s, line %d: a value is missing or not a number" % (path, reader.line_num)
                    )
                if not all(0 < t < LATEST for t in (stamp, receipt)):
                    raise GroundError(
                        "%s, line %d: a stamp is not a time between 1970 and 2106 in nanoseconds"
                        % (path, reader.line_num)
                    )
                if not all(map(math.isfinite, point)):
                    raise GroundError(
                        "%s, line %d: a value is not finite" % (path, reader.line_num)
                    )
                if stamps and stamp < stamps[-1]:
                    raise GroundError(
                        "%s, line %d: the stamp is %.6f s before that of the row above"
                        % (path, reader.line_num, 1e-9 * (stamps[-1] - stamp))
                    )
                stamps.append(stamp)
                received.append(receipt)
                points.append(point)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise GroundError("%s: cannot be read (%s)" % (path, error))
    if len(stamps) < 2:
        raise GroundError("%s: only %d rows" % (path, len(stamps)))
    return stamps, received, np.array(points)


def write_bag(
    controls_path: str,
    pose_path: str,
    bag_path: str,
    force: bool = False,
    work: Optional[Work] = None,
) -> Dict[str, int]:
    """Writes a pair of CSV exports to a bag; returns the number of messages by topic. work: told of
    what is read and written."""
    codec, told = codecs.installed(), work or Work()
    series = {}
    with told.stage("reading tables", 2):
        for topic, path in told.each((("pose", pose_path), ("controls", controls_path))):
            series[topic] = read_csv(path)
    for topic, path in (("pose", pose_path), ("controls", controls_path)):
        stamps, _, points = series[topic]
        rows = np.column_stack([np.array(stamps) * 1e-9, points])
        other = np.array([[0.0, 0, 0, 0], [1.0, 0, 0, 0]])
        pair = (rows, other) if topic == "pose" else (other, rows)
        checked(path, pair[0], pair[1], "", [])
    spans = [(min(r), max(r)) for _, r, _ in series.values()]
    if max(s[0] for s in spans) > min(s[1] for s in spans):
        raise GroundError(
            "%s and %s do not overlap in time: they are from different runs" % (controls_path, pose_path)
        )
    with files.new_file(bag_path, force) as temporary:
        with codec.bag_writer(temporary) as bag, told.stage("writing topics", len(series)):
            for topic, columns in told.each(series.items()):
                for sequence, (stamp, receipt, point) in enumerate(zip(*columns)):
                    message = codec.new("geometry_msgs/PointStamped")
                    message.header.seq = sequence
                    message.header.stamp = codec.Time(*divmod(stamp, 10**9))
                    message.point.x, message.point.y, message.point.z = point
                    bag.write(topic, message, codec.Time(*divmod(receipt, 10**9)))
    return {topic: len(columns[0]) for topic, columns in series.items()}
