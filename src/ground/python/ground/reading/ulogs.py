"""Logs of PX4 (ULog) as containers, read by pyulog.

Topics have the names of their messages; topics of a second sensor end with its number, "sensor_gyro_1".
Times count from the start of the computer.
"""

import numpy as np

from ground.reading.containers import RECEIVED, Columns, Container, Topic
from ground.support.errors import GroundError

TIME = "timestamp"  # field of all messages [us]
# Counters of resets of the estimator, and what each moves: a number, and by how much it was moved last
RESETS = {
    "xy_reset_counter": {"x": "delta_xy[0]", "y": "delta_xy[1]"},
    "z_reset_counter": {"z": "delta_z"},
    "heading_reset_counter": {"heading": "delta_heading"},
}


class Ulog(Container):
    """A log of PX4. Raises GroundError when it cannot be read."""

    def __init__(self, path: str) -> None:
        super().__init__(path)
        try:
            import pyulog
        except ImportError:
            raise GroundError("%s: PX4 logs need the Python module pyulog: pip install pyulog" % path)
        try:
            log = pyulog.ULog(path)
        except Exception as error:  # pyulog raises errors of any kind on damaged files
            raise GroundError("%s: cannot be read as a PX4 log (%s)" % (path, error))
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
            self.warnings.append("the log is damaged: only its intact beginning is read")

    def table(self, topic: str) -> Columns:
        """See Container."""
        data = self._tables[topic]
        received = np.asarray(data[TIME]).astype(np.int64) * 1000
        columns = {name: np.asarray(values) for name, values in data.items() if name != TIME}
        for counter, moved in RESETS.items():
            if {counter, *moved, *moved.values()} <= set(columns):
                counts = np.diff(columns[counter], prepend=columns[counter][:1])  # of 8 bits, which may wrap
                for name, delta in moved.items():
                    columns[name] = columns[name] - np.cumsum(np.where(counts, columns[delta], 0.0))
                for at in np.flatnonzero(counts)[:1]:
                    steps = " and ".join("%s by %.3g" % (n, columns[delta][at]) for n, delta in moved.items())
                    text = "%s: %d of %d resets (%s) are undone; that at %.2f s moved %s"
                    numbers = np.count_nonzero(counts), counts.sum(dtype=int), counter, 1e-9 * received[at]
                    self.warnings.append(text % (topic, *numbers, steps))
        return {RECEIVED: received, **columns}
