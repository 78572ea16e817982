"""Logs of PX4 (ULog) as containers, read by pyulog.

Topics have the names of their messages; those of a second sensor end with its number, "sensor_gyro_1". Times
are those since the computer started.
"""

from typing import Sequence, Tuple

import numpy as np

from ground.recordings.containers import RECEIVED, Columns, Container, Topic
from ground.support.annotations import Array
from ground.support.errors import GroundError

MAGIC = b"ULog\x01\x12\x35"  #: first bytes of such a log
TIME = "timestamp"  # field of all messages [us]
# What a reset of PX4's estimator moves, by the counter of such resets: numbers, and by how much each was moved
RESETS = {
    "xy_reset_counter": (("x", "delta_xy[0]"), ("y", "delta_xy[1]")),
    "z_reset_counter": (("z", "delta_z"),),
    "heading_reset_counter": (("heading", "delta_heading"),),
}


class Ulog(Container):
    """A log of PX4. Raises GroundError when it cannot be read."""

    def __init__(self, path: str) -> None:
        super().__init__(path)
        try:
            import pyulog
        except ImportError:
            raise GroundError("%s: logs of PX4 take the Python module pyulog: pip install pyulog" % path)
        try:
            log = pyulog.ULog(path)
        except Exception as error:  # pyulog raises errors of any kind on damaged files
            raise GroundError("%s: cannot be read as a log of PX4 (%s)" % (path, error))
        self._tables = {
            one.name + ("_%d" % one.multi_id if one.multi_id else ""): one.data for one in log.data_list
        }
        for topic, data in self._tables.items():
            self.topics[topic] = Topic("px4/" + topic.rstrip("_0123456789"), len(data[TIME]))
        lost = sum(dropout.duration for dropout in log.dropouts)
        if log.dropouts:
            self.warnings.append(
                "the log lost messages %d times, for %.2g s" % (len(log.dropouts), lost / 1e3)
            )
        if log.file_corruption:
            self.warnings.append("the log is damaged: read as far as it is whole")

    def table(self, topic: str) -> Columns:
        """See Container."""
        data = self._tables[topic]
        received = np.asarray(data[TIME]).astype(np.int64) * 1000
        columns = {name: np.asarray(values) for name, values in data.items() if name != TIME}
        for counter, moved in RESETS.items():
            if counter in columns and {name for pair in moved for name in pair} <= set(columns):
                self._undo(topic, columns, counter, moved, 1e-9 * received)
        return {RECEIVED: received, **columns}

    def _undo(
        self, topic: str, columns: Columns, counter: str, moved: Sequence[Tuple[str, str]], times: Array
    ) -> None:
        """Takes what resets have moved out of some columns, in place. times (n,) [s]."""
        steps = np.diff(columns[counter], prepend=columns[counter][:1])  # a counter of 8 bits may wrap
        for name, delta in moved:
            undone = columns[name] - np.cumsum(np.where(steps, columns[delta], 0.0))
            columns[name] = np.angle(np.exp(1j * undone)) if name == "heading" else undone
        events = [
            "%s at %.2f s" % (", ".join("%+.3g" % columns[d][i] for _, d in moved), times[i])
            for i in np.flatnonzero(steps)
        ]
        what = " and ".join(name for name, _ in moved)
        if events:
            note = "%s: the estimator reset %s, by its counter, which is undone: %s"
            self.warnings.append(note % (topic, what, "; ".join(events[:4]) + "; ..." * (len(events) > 4)))
        if (steps > 1).any():
            note = "%s: %s was reset several times between two messages, of which the log has the last step only"
            self.warnings.append(note % (topic, what))
