"""What the live plot shows: the last seconds of some topics, and the last statuses of nodes."""

import math
import threading
import time
from typing import Any, Callable, Dict, List, Sequence, Tuple

import numpy as np
import rospy
from ground_msgs import msg

from ground.support.annotations import Array, Message

JUMP = 0.5  # jump back in time that clears what is drawn, more than disorder of messages [s]
GAP = 0.3  # longest gap between samples across which a line is drawn [s]
_PREDICTED = ["nu[0]", "nu[1]", "nu[2]", "position_error", "heading_error", "position_noise", "heading_noise"]
_PREDICTED += ["%s[%d]" % (name, i) for name in ("wrench", "wrench_noise") for i in range(3)]
# Fields that messages do not have: how far a prediction is off in position [m] and heading [rad]; NaN where
# any model would do.
COMPUTED: Dict[str, Callable[[Message], float]] = {
    "off": lambda error: math.hypot(*error.eta_error[:2]) if error.excited else math.nan,
    "turned": lambda error: math.fabs(error.eta_error[2]) if error.excited else math.nan,
}
_INPUTS = ["left", "right", "lift"]
TOPICS: Dict[str, Tuple[Any, List[str]]] = {  # type, and the fields that are drawn
    "state": (msg.State, ["eta[0]", "eta[1]", "nu[0]", "nu[1]", "nu[2]"]),
    "model_error": (msg.ModelError, [*_PREDICTED, *COMPUTED]),
    "model_error2": (msg.ModelError, [*_PREDICTED, *COMPUTED]),
    "controls": (msg.Controls, _INPUTS),
    "controls/wanted": (msg.Controls, _INPUTS),
    "reference": (msg.Reference, ["p[0]", "p[1]"]),
}
EXPECTED = ["state", "model_error", "controls"]  # every experiment and every replay has these
MODELS = ["model_error", "model_error2"]
STATUSES = {"controller/status": msg.ControllerStatus, "sender/status": msg.SenderStatus}


class SignalBuffer:
    """Stamps and numbers of a topic. Columns never change once written, so that readers need no copy."""

    def __init__(self, count: int, duration: float) -> None:
        """count: numbers of a sample; duration: kept before the newest one [s]."""
        self._duration = duration
        self._columns = np.empty((1 + count, 1024))
        self._end = 0
        self.newest = -math.inf  # stamp [s]

    def add(self, stamp: float, numbers: Sequence[float]) -> None:
        """Adds a sample; one that is not newer than the newest is left out."""
        if stamp <= self.newest:
            return
        if stamp - self.newest > GAP and self._end:
            self._append(self.newest + GAP / 2, [math.nan] * len(numbers))
        self._append(stamp, numbers)
        self.newest = stamp

    def since(self, stamp: float) -> Array:
        """Samples from a stamp on [s], (1 + count, n): stamps [s], and the numbers."""
        used = self._columns[:, : self._end]
        return used[:, int(np.searchsorted(used[0], stamp)) :]

    def _append(self, stamp: float, numbers: Sequence[float]) -> None:
        if self._end == self._columns.shape[1]:
            kept = self.since(stamp - self._duration)
            self._end = kept.shape[1]
            self._columns = np.hstack([kept, np.empty((len(kept), self._end + 1024))])
        self._columns[:, self._end] = [stamp, *numbers]
        self._end += 1


class Feed:
    """The newest data of the topics: samples, and the last statuses.

    Subscribes: state, model_error, model_error2, controls, controls/wanted, reference,
    controller/status, sender/status.
    """

    def __init__(self, duration: float) -> None:
        """duration: length of the history [s]."""
        self.duration = duration
        self.models: Dict[str, msg.ModelError] = {}  # topic to newest message
        self.statuses: Dict[str, Tuple[Message, float]] = {}  # newest message, received [s]
        self.invalid = ""  # why the newest state is invalid
        self.heard = -math.inf  # when the newest sample came, time.monotonic() [s]
        self._lock = threading.Lock()
        self._clear()

    def connect(self) -> None:
        """Subscribes; the node has to be initialised."""
        for topic, (kind, _) in TOPICS.items():
            rospy.Subscriber(topic, kind, self.take, topic)
        for topic, kind in STATUSES.items():
            rospy.Subscriber(topic, kind, self.take_status, topic)

    def take(self, message: Message, topic: str) -> None:
        """Takes a message of one of TOPICS. Time that jumps back clears all curves: a bag or a
        simulation began again."""
        stamp = message.header.stamp.to_sec()
        numbers = [_number(message, field) for field in TOPICS[topic][1]]
        if topic in MODELS:
            self.models[topic] = message
        elif topic == "state":
            self.invalid = "" if message.valid else message.status or "no reason is given"
            numbers = numbers if message.valid else [math.nan] * len(numbers)
        self.heard = time.monotonic()
        with self._lock:
            if stamp < self._histories[topic].newest - JUMP:
                self._clear()
            if stamp > 0:  # others have no stamp
                self._histories[topic].add(stamp, numbers)

    def take_status(self, message: Message, topic: str) -> None:
        """Takes a message of one of STATUSES."""
        self.statuses[topic] = (message, time.monotonic())

    def samples(self) -> Tuple[float, Dict[str, Array]]:
        """The newest stamp [s] (infinite before the first), and the samples by topic, as SignalBuffer.since
        has them. They are not copies."""
        with self._lock:
            now = max(history.newest for history in self._histories.values())
            return now, {t: h.since(now - self.duration) for t, h in self._histories.items()}

    def _clear(self) -> None:
        self._histories = {t: SignalBuffer(len(f), self.duration) for t, (_, f) in TOPICS.items()}


def _number(message: Message, field: str) -> float:
    if field in COMPUTED:
        return COMPUTED[field](message)
    name, _, index = field.rstrip("]").partition("[")
    value = getattr(message, name)
    return float(value[int(index)] if index else value)


def tracking_error(state: Array, reference: Array) -> Array:
    """Distance between craft and reference at the reference's stamps, up to the newest state, as
    (2, n): stamps [s], distance [m]; NaN where the state is not valid. state, reference: samples of
    these topics."""
    if not state.shape[1]:
        return np.empty((2, 0))
    times, *p = reference[:, reference[0] <= state[0, -1]]
    at = [np.interp(times, state[0], row, left=math.nan) for row in state[1:3]]
    return np.array([times, np.hypot(at[0] - p[0], at[1] - p[1])])


def smoothed(times: Array, values: Array, width: float) -> Array:
    """Means of values, (n,), by triangular weights that reach `width` [s] to both sides; NaN stays NaN."""
    known = np.isfinite(values)
    counts = np.concatenate([[0], np.cumsum(known)])
    first = np.searchsorted(times, times - width / 2, "left")
    last = np.searchsorted(times, times + width / 2, "right")
    for _ in range(2):
        sums = np.concatenate([[0.0], np.cumsum(np.where(known, values, 0.0))])
        means = (sums[last] - sums[first]) / np.maximum(counts[last] - counts[first], 1)
        values = np.where(known, means, math.nan)
    return values
