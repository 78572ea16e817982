"""identify import: CSV files that rostopic echo -p has written, to a bag."""

import argparse
import os
import shlex
from typing import Dict, Optional, Tuple

import numpy as np

from ground.reading import containers, messages
from ground.reading.instants import END_OF_ROS
from ground.reading.recording import checked
from ground.support import command_line, files
from ground.support.annotations import Array, Indices
from ground.support.errors import GroundError
from ground.support.headline import formatted
from ground.support.progress import Work

RECEIVED = "%time"
STAMP = "field.header.stamp"
POINT = ["field.point.x", "field.point.y", "field.point.z"]
NO_EXPORT = (
    "%s: no export of rostopic echo -p; other tables are read as they are, by a mapping: "
    "identify info %s --write-mapping M.yaml"
)


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the verb's arguments."""
    parser.add_argument("controls", metavar="CONTROLS.csv", help="left, right, lift as field.point.x, y, z")
    parser.add_argument("pose", metavar="POSE.csv", help="x, y [m], psi [rad] as field.point.x, y, z")
    parser.add_argument("-o", "--output", metavar="RUN.bag", required=True)
    parser.add_argument("--force", action="store_true", help="overwrite the bag")


def run(arguments: argparse.Namespace) -> Dict[str, object]:
    """Runs the verb; returns what --json prints."""
    output = arguments.output
    files.refuse_existing(output, arguments.force)
    messages.refuse_other_format(output)
    counts = write_bag(arguments.controls, arguments.pose, output, arguments.force, arguments.work)
    head = [
        ("Imported", "%d poses and %d commands." % (counts["pose"], counts["controls"])),
        ("Recording", output),
        ("Next", "look at it:\nrosrun ground identify info %s" % output),
    ]
    for line in formatted(head):
        command_line.say(arguments, line)
    return {"bag": output, "messages": counts}


def read_csv(path: str) -> Tuple[Indices, Indices, Array]:
    """Stamps, times of receipt [ns] and points (n, 3) of a `rostopic echo -p` export."""
    with containers.Tables([path]) as tables:
        columns = tables.table(os.path.basename(path))
    if not {STAMP, RECEIVED, *POINT} & set(columns):
        raise GroundError(NO_EXPORT % (path, shlex.quote(path)))
    times = [STAMP, RECEIVED if RECEIVED in columns else STAMP]
    numbers = containers.values(columns, [*times, *POINT], path)
    outside = ~((numbers[:, :2] > 0) & (numbers[:, :2] < END_OF_ROS)).all(axis=1)
    for wrong, what in (
        (~np.isfinite(numbers).all(axis=1), "a value is missing, not a number or not finite"),
        (outside, "a stamp is not a time between 1970 and 2106 in nanoseconds"),
    ):
        if wrong.any():
            raise GroundError("%s, line %d: %s" % (path, np.argmax(wrong) + 2, what))
    # as whole numbers, which have more digits than a float
    stamps, received = (np.asarray(containers.column(columns, n)).astype(np.int64) for n in times)
    return stamps, received, numbers[:, 2:]


def write_bag(
    controls_path: str, pose_path: str, bag_path: str, force: bool = False, work: Optional[Work] = None
) -> Dict[str, int]:
    """Writes a pair of CSV exports to a bag; returns the number of messages by topic. work: told of
    what is written."""
    told = work or Work()
    series = {"pose": read_csv(pose_path), "controls": read_csv(controls_path)}
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
