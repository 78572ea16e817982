"""The last seconds of some topics, and how they are drawn; without ROS and without a window."""

import math
import threading
from dataclasses import dataclass
from typing import Dict, List, Optional, Sequence, Tuple, Union

import numpy as np

from ground.annotations import Array

JUMP = 0.5  # jump back in time that clears the histories, more than disorder of messages [s]
ROOM = 256  # initial capacity of a history [samples]
GAP = 0.3  # longest gap between samples across which a line is drawn [s]
HEADROOM = 0.15  # share that a new range of an axis leaves free on each side
SLACK = 2.5  # a range this many times wider than needed is narrowed

Span = Tuple[float, float]


@dataclass
class Samples:
    """Samples of one topic, oldest first; a column that is not a number breaks the line."""

    times: Array  # (n,) stamps [s]
    values: Array  # (channels, n)


class History:
    """Samples of one topic, of the last `duration` seconds before the newest.

    They are contiguous in an array with spare room, and never change once written, so that readers
    need no copy. When the room is used up, the samples in use move into a new array.
    """

    def __init__(self, channels: int, duration: float) -> None:
        self._duration = duration
        self._channels = channels
        self.clear()

    def clear(self) -> None:
        """Forgets all samples."""
        self._rows = np.empty((1 + self._channels, ROOM))  # stamps, then channels
        self._begin = self._end = 0  # columns in use

    @property
    def newest(self) -> Optional[float]:
        """Stamp of the newest sample [s]; None when there is none."""
        return float(self._rows[0, self._end - 1]) if self._end > self._begin else None

    def add(self, stamp: float, values: Union[Sequence[float], Array]) -> None:
        """Adds a sample (stamp [s]); one that is not newer than the newest is left out."""
        newest = self.newest
        if newest is not None:
            if stamp <= newest:
                return
            if stamp - newest > GAP:
                self._append(newest + GAP / 2, math.nan)
        self._append(stamp, values)
        self._drop_before(stamp - self._duration)

    def samples(self, since: float) -> Samples:
        """The samples with stamps from `since` on [s]."""
        used = self._rows[:, self._begin : self._end]
        chosen = used[:, int(np.searchsorted(used[0], since)) :]
        return Samples(chosen[0], chosen[1:])

    def _append(self, stamp: float, values: Union[float, Sequence[float], Array]) -> None:
        if self._end == self._rows.shape[1]:
            used = self._rows[:, self._begin :]
            self._begin, self._end = 0, used.shape[1]
            self._rows = np.empty((len(used), 2 * used.shape[1] + ROOM))
            self._rows[:, : self._end] = used
        self._rows[0, self._end] = stamp
        self._rows[1:, self._end] = values
        self._end += 1

    def _drop_before(self, stamp: float) -> None:
        while self._rows[0, self._begin] < stamp:
            self._begin += 1


class LiveBuffers:
    """The histories of several topics on one time axis, filled and read by different threads.

    A stamp that jumps back on any topic clears all of them: a bag or a simulation began again.
    """

    def __init__(self, channels: Dict[str, int], duration: float) -> None:
        """channels: how many numbers a sample has, by topic. duration: time that is kept [s]."""
        self.duration = duration
        self.version = 0  # grows with every change
        self._lock = threading.Lock()
        self._histories = {topic: History(n, duration) for topic, n in channels.items()}

    def add(self, topic: str, stamp: float, values: Sequence[float]) -> None:
        """Adds a sample (stamp [s]). A stamp of 0 means that the message has none: it is left out.
        Infinite values become NaN."""
        if stamp <= 0:
            return
        row = np.asarray(values, float)
        row[np.isinf(row)] = math.nan
        with self._lock:
            newest = self._histories[topic].newest
            if newest is not None and stamp < newest - JUMP:
                for history in self._histories.values():
                    history.clear()
            self._histories[topic].add(stamp, row)
            self.version += 1

    def snapshot(self) -> Tuple[Optional[float], Dict[str, Samples]]:
        """The newest stamp of all topics [s] (None before the first), and their samples of the
        `duration` before it. They are not copies: do not change them."""
        with self._lock:
            stamps = [h.newest for h in self._histories.values() if h.newest is not None]
            now = max(stamps) if stamps else None
            since = math.inf if now is None else now - self.duration
            return now, {t: h.samples(since) for t, h in self._histories.items()}

    def silent(self, topics: Sequence[str]) -> List[str]:
        """Topics among `topics` without a sample since the start or the last jump back."""
        with self._lock:
            return [topic for topic in topics if self._histories[topic].newest is None]


def tracking_error(state: Samples, reference: Samples) -> Samples:
    """Distance between craft and reference at the reference's stamps, up to the newest state.

    state: its first two channels are x and y, world_ned [m]; reference: x and y [m]. Returns one
    channel [m]; it is NaN before the first state and where the state is invalid.
    """
    if len(state.times) == 0:
        return Samples(np.empty(0), np.empty((1, 0)))
    count = np.searchsorted(reference.times, state.times[-1], side="right")
    times, p = reference.times[:count], reference.values[:, :count]
    x, y = (np.interp(times, state.times, row, left=math.nan) for row in state.values[:2])
    return Samples(times, np.hypot(x - p[0], y - p[1])[np.newaxis])


def thinned(times: Array, values: Array, points: int) -> Tuple[Array, Array]:
    """A curve in about `points` points: the smallest and the largest of every few samples."""
    together = math.ceil(2 * len(times) / points)
    if together <= 2:
        return times, values
    end = len(times) // together * together
    groups = values[:end].reshape(-1, together)
    pairs = np.column_stack([groups.min(axis=1), groups.max(axis=1)]).ravel()
    starts = np.repeat(times[:end:together], 2)
    return np.append(starts, times[end:]), np.append(pairs, values[end:])


def extent(values: Array) -> Tuple[float, ...]:
    """Smallest and largest of the values (n,) that are not NaN; empty when there are none."""
    low = np.fmin.reduce(values, initial=math.nan)
    return () if math.isnan(low) else (float(low), float(np.fmax.reduce(values, initial=math.nan)))


def axis_range(low: float, high: float, shown: Span, least: float) -> Span:
    """The range of an axis that shows low to high.

    shown: the present range. It stays as long as it fits, because an axis that moves with every
    picture cannot be read. least: the smallest span.
    """
    middle, span = (low + high) / 2, max(high - low, least)
    fits = shown[0] <= low and high <= shown[1]
    if fits and span <= shown[1] - shown[0] <= SLACK * span:
        return shown
    half = (0.5 + HEADROOM) * span
    return middle - half, middle + half


def ticks(low: float, high: float, most: int) -> List[float]:
    """Round values from low to high, no more than `most`, in steps of 1, 2 or 5 times a power of ten."""
    rough = (high - low) / (most - 1)
    power = 10.0 ** math.floor(math.log10(rough))
    step = power * next(factor for factor in (1, 2, 5, 10) if factor * power >= rough)
    first, last = math.ceil(low / step), math.floor(high / step)
    return [i * step for i in range(first, last + 1)]
