"""Stamps of messages and rows: from the header, the time of receipt, or fields."""

from typing import Callable, Optional, Tuple

from ground.annotations import Array, Indices, Message, Time
from ground.errors import GroundError
from ground.recordings.batches import Batch
from ground.recordings.codecs.with_rosbags import Time as PlainTime
from ground.recordings.fields import getter
from ground.recordings.mapping import HEADER, RECEIPT, TIMES, Clock

LATEST = 2**32 * 10**9  # seconds of ROS have 32 bits [ns]

Stamp = Callable[[Message, Optional[Time]], Time]  # takes a message and its time of receipt


def stamps(clock: Clock, where: str) -> Stamp:
    """Gives the stamps of messages; where: the file and topic, for errors."""
    if clock.field:
        return _of_field(clock, where)

    def stamp(message: Message, received: Optional[Time]) -> Time:
        header = None if clock.source == RECEIPT else getattr(message, "header", None)
        if header is not None:
            return header.stamp
        if clock.source == HEADER or received is None:
            raise GroundError(
                "%s: %s; name the field that is the time in a mapping"
                % (where, "no header" if clock.source == HEADER else "no time of receipt")
            )
        return received

    return stamp


def batch_stamps(clock: Clock, batch: Batch) -> Optional[Tuple[Array, Indices]]:
    """The stamps of a Batch in seconds and in nanoseconds; None where they have to be taken one by one."""
    if clock.field:
        return None
    headers = None if clock.source == RECEIPT else batch.stamps()
    if headers is None and clock.source != HEADER:
        return batch.received, batch.received_ns
    return headers


def _of_field(clock: Clock, where: str) -> Stamp:
    paths = [path for path in (clock.field, clock.nanoseconds) if path]
    get, unit = getter(paths), TIMES[clock.unit]

    def stamp(message: Message, _: Optional[Time]) -> Time:
        first, *more = get(message)
        try:
            # Integers stay exact: those of nanoseconds have more digits than a float.
            whole = first * unit if isinstance(first, int) else int(round(float(first) * unit))
            total = int(whole) + sum(int(value) for value in more)
        except (TypeError, ValueError, OverflowError):
            raise GroundError("%s: a time is %s, which is not a number" % (where, first))
        if not 0 <= total < LATEST:
            raise GroundError(
                "%s: a time is %s %s, which is not between 1970 and 2106; the key unit of the "
                "mapping's time may be wrong" % (where, first, clock.unit)
            )
        return PlainTime(*divmod(total, 10**9))

    return stamp
