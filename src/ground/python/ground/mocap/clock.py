"""The mocap's clock beside this computer's, and the order of frames."""

import collections
import math
from dataclasses import dataclass
from typing import Deque, Optional, Tuple

from ground.mocap.frames import Frame, Pose

WINDOW = 10.0  # time over which the least delay of a frame counts; the clocks drift [s]
JUMP = 0.02  # a frame that comes this much too early shows that the mocap's clock was set [s]
SETTLING = 1.0  # time at the begin in which the least delay is being found [s]
LATE = 1.0  # a frame that is older than this beside the newest shows that the mocap began again [s]


class Offset:
    """This computer's clock minus the mocap's: the running minimum of arrival minus sending.

    Frames are delayed by the network and by busy computers, by different times. The least delay within the
    last `WINDOW` is taken for none.
    """

    def __init__(self) -> None:
        self.value = math.nan  #: [s]; nan before the first frame
        self.jump = 0.0  #: by how much a clock was set before the last frame [s]
        self._begun = math.inf
        self._least: Deque[Tuple[float, float]] = collections.deque()  # (arrival, offset), both increasing

    def restart(self) -> None:
        """Forgets what was seen: the mocap's clock was set back."""
        self._least.clear()

    def update(self, sent: float, received: float) -> None:
        """Takes a frame: when it was sent by the mocap's clock, and when it came by this computer's [s]."""
        now, before = received - sent, self.value
        is_set = not self._least or now < before - JUMP
        while self._least and self._least[-1][1] >= now:
            self._least.pop()
        self._least.append((received, now))
        while self._least[0][0] < received - WINDOW:
            self._least.popleft()
        self.value = self._least[0][1]
        self._begun = min(self._begun, received)
        self.jump = self.value - before if is_set and received > self._begun + SETTLING else 0.0


@dataclass(frozen=True)
class Sighting:
    """A frame for one body."""

    captured: float  #: by this computer's monotonic clock [s]; the arrival if the mocap gives no time
    frame: Frame
    offset: float  #: monotonic clock minus the mocap's [s]; nan if the mocap gives no time
    missed: int  #: frames that did not come between the one before and this one
    late: int  #: frames since the one before that came late or again, and were left out
    pose: Optional[Pose]  #: None: the body was not seen


class Follower:
    """Follows one body through the frames of a mocap. Frames that come late, twice, or out of order are left
    out."""

    def __init__(self, body: str) -> None:
        self.body = body
        self.offset = Offset()
        self._late = 0
        self._last: Optional[Frame] = None

    def take(self, frame: Frame) -> Optional[Sighting]:
        """The sighting in the next frame; None for one that is left out."""
        last, again = self._last, False
        if last is not None:
            again = _begins_again(last, frame)
            if not again and _is_late(last, frame):
                self._late += 1
                return None
        missed = 0
        if last is not None and not again and frame.number is not None and last.number is not None:
            missed = frame.number - last.number - 1
        self._last, late, self._late = frame, self._late, 0
        captured, offset = frame.received, math.nan
        if frame.time is not None:
            if again:
                self.offset.restart()
            self.offset.update(frame.time + frame.delay, frame.received)
            offset = self.offset.value
            captured = frame.time + offset
        return Sighting(captured, frame, offset, missed, late, frame.poses.get(self.body))


def _is_late(last: Frame, frame: Frame) -> bool:
    if frame.number is None or last.number is None:
        return False
    return frame.number <= last.number


def _begins_again(last: Frame, frame: Frame) -> bool:
    """Whether the mocap was restarted, or its clock set back."""
    if frame.time is None or last.time is None:
        return _is_late(last, frame) and frame.received - last.received > LATE
    if not _is_late(last, frame):
        return frame.number is not None and frame.time <= last.time
    return frame.time < last.time - LATE or frame.received - last.received > LATE
