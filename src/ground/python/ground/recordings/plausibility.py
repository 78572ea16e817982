"""Implausible data: single stamps and commands that damage to a file has changed.

A bag without compression has no checksum. A flipped bit shows only where the file says the same thing
twice, or where one message is unlike all others.
"""

from typing import Iterator, Sequence, Tuple

import numpy as np

from ground.annotations import Array, ArrayLike, Flags, Indices

MIN_STAMP_ERROR = 1e-3  # least error of a stamp against the recorder's clock if delays are exact [s]
MIN_LIVE_ERROR = (
    0.015  # the same if delays scatter; a busy recorder is late by up to half of it [s]
)
MIN_SCATTERS = 20  # least error in multiples of the typical scatter of delays
EXACT = 1e-4  # scatter of delays below which no message is ever late [s]
REGULAR = 0.25  # largest unevenness of receipts and delays around, relative to the error
MAX_SHARE = 0.01  # largest share of wrong stamps; more are no damage but the system's behaviour
NEIGHBOURS = 2  # messages on each side that a message is compared with
MAX_LEVELS = 8  # number of levels between which commands switch
LEVEL_SHARE = 0.98  # least share of commands at a level


def mend_stamps(stamps: ArrayLike, received: ArrayLike) -> Tuple[Array, int, float]:
    """Replaces single stamps [s] that contradict the recorder's clock while their neighbours agree with
    it. Returns the stamps, the number replaced, and the largest error [s].

    stamps, received: (n,) in the order of receipt, on clocks that may differ by a constant or drift.
    """
    stamps, received = np.array(stamps, float), np.asarray(received, float)
    if len(stamps) < 2 * NEIGHBOURS + 2:
        return stamps, 0, 0.0
    delays = received - stamps
    around = delays[_neighbours(len(delays))]
    typical = np.median(around, axis=1)
    error = np.abs(delays - typical)
    steps = np.diff(received)
    uneven = np.abs(np.diff(steps))  # deviation of a receipt from the middle of its neighbours
    uneven = 0.5 * np.concatenate([uneven[:1], uneven, uneven[-1:]])
    scatter = np.median(error)
    # A late message looks like a stamp that is too early; no message comes too soon.
    punctual = (uneven < REGULAR * error) | (delays < typical) | (scatter < EXACT)
    alike = np.ptp(around, axis=1) < REGULAR * error
    least = MIN_STAMP_ERROR if scatter < EXACT else MIN_LIVE_ERROR
    wrong = (error > max(least, MIN_SCATTERS * scatter)) & alike & punctual
    wrong &= ~_overtaken(stamps)
    count = int(wrong.sum())
    if count == 0 or count > max(2, MAX_SHARE * len(stamps)):
        return stamps, 0, 0.0
    stamps[wrong] = (received - typical)[wrong]
    return stamps, count, float(error[wrong].max())


def lone_commands(
    times: Array, controls: Array, channels: Sequence[str]
) -> Iterator[str]:
    """Sentences about commands with a unique value if all others switch between a few levels. times:
    (m,) [s]; controls: (m, c) by `channels`."""
    for channel, values in zip(channels, controls.T):
        levels, counts = np.unique(values, return_counts=True)
        often = counts > 2
        inside = np.isin(levels, values[1:-1])  # a run may begin or end with a command of its own
        lone = levels[(counts == 1) & inside]
        if (
            0 < len(lone) <= 2
            and often.sum() <= MAX_LEVELS
            and counts[often].sum() >= LEVEL_SHARE * len(values)
        ):
            at = [int(np.flatnonzero(values == value)[0]) for value in lone]
            yield "the command %s is %s, a value that no other command has: the bag may be damaged" % (
                channel,
                " and ".join("%g at %.2f s" % (values[i], times[i] - times[0]) for i in at),
            )


def _overtaken(stamps: Array) -> Flags:
    """Which messages arrived in the wrong order with correct stamps: sorted, each is about a period
    from the one before and the one after. stamps: (n,) [s]."""
    order = np.argsort(stamps, kind="stable")
    steps = np.diff(stamps[order])
    period = np.median(steps)
    even = np.abs(steps - period) < 0.5 * period
    placed = np.append(even, False) & np.append(False, even)
    found = np.zeros(len(stamps), bool)
    found[order] = placed & (order != np.arange(len(stamps)))
    return found


def _neighbours(count: int) -> Indices:
    """Indices (count, 2 * NEIGHBOURS) of the neighbours of each of `count` messages."""
    first = np.clip(np.arange(count) - NEIGHBOURS, 0, count - 2 * NEIGHBOURS - 1)
    window = first[:, None] + np.arange(2 * NEIGHBOURS + 1)
    others = window != np.arange(count)[:, None]
    return np.asarray(window[others].reshape(count, 2 * NEIGHBOURS))
