"""Implausible data: single stamps and commands that damage to a file has changed.

A bag without compression has no checksum. A flipped bit shows only where the file says the same thing
twice: a stamp and its time of receipt, a command and its repetition. Something is called damaged if it is
exactly one bit away from what is expected, and nothing else in the recording is as far from it.
"""

from typing import Dict, Iterator, Sequence, Set, Tuple

import numpy as np

from ground.annotations import Array, ArrayLike, Flags, Indices

BITS = 32  # size of the nanoseconds of a stamp, and of its seconds [bits]
STAMP_BITS = np.outer([1e-9, 1.0], 2.0 ** np.arange(BITS)).ravel()  # what each is worth [s]
MIN_STAMP_ERROR = 1e-3  # least error of a stamp that is replaced [s]
RESOLUTION = 1e-6  # rounding of a stamp as a floating-point number of seconds [s]
REGULAR = 0.25  # largest range of the delays of the neighbours, relative to the error
APART = 2.0  # least error relative to the largest one that no flipped bit explains
MAX_SHARE = 0.01  # largest share of wrong stamps; more are no damage but the system's behaviour
NEIGHBOURS = 2  # messages on each side that a message is compared with
MIN_CHANGE = 1e-6  # least change of a command that matters
REPEATED = 10  # number of commands before and after a damaged one that must all be repeated


def mend_stamps(stamps: ArrayLike, received: ArrayLike) -> Tuple[Array, int, float]:
    """Undoes single flipped bits of stamps [s], by the recorder's clock. Returns the stamps, the number
    of those mended, and the largest error [s].

    stamps, received: (n,) in the order of receipt, on clocks that may differ by a constant or drift. A
    message that a busy computer stamps or receives late is off by any time; a flipped bit puts the
    stamp off by a power of two, and flipped back, its delay is like those of its neighbours.
    """
    stamps, received = np.array(stamps, float), np.asarray(received, float)
    if len(stamps) < 2 * NEIGHBOURS + 2:
        return stamps, 0, 0.0
    delays = received - stamps
    around = delays[_neighbours(len(delays))]
    late = np.median(around, axis=1) - delays  # how late each stamp is [s]
    error, spread = np.abs(late), np.ptp(around, axis=1)
    bit = np.argmin(np.abs(error[:, None] - STAMP_BITS), axis=1)
    mended = stamps - np.sign(late) * STAMP_BITS[bit]
    flipped = np.abs(error - STAMP_BITS[bit]) <= spread + np.median(spread) + RESOLUTION
    flipped &= _bits(mended, bit) == (late < 0)
    least = max(MIN_STAMP_ERROR, APART * float(error[~flipped].max(initial=0.0)))
    wrong = flipped & (error > least) & (spread < REGULAR * error)
    count = int(wrong.sum())
    if count == 0 or count > max(2, MAX_SHARE * len(stamps)):
        return stamps, 0, 0.0
    return np.where(wrong, mended, stamps), count, float(error[wrong].max())


def lone_commands(times: Array, controls: Array, channels: Sequence[str]) -> Iterator[str]:
    """Sentences about commands with a flipped bit. times: (m,) [s]; controls: (m, c) by `channels`, as
    they are in the file.

    Such a command has a value that no other command has, and is the message before or after it but for
    one bit. That alone also happens to a coarse controller; but where every other command is repeated,
    a single message is odd. The first and the last message of a recording may be parts of longer levels.
    """
    before, channel = _one_bit_apart(controls)
    found: Dict[int, Set[int]] = {}  # by channel
    for i, c in zip(before.tolist(), channel.tolist()):
        for at, repeats in ((i, i + 1), (i + 1, i)):
            lone = (controls[:, c] == controls[at, c]).sum() == 1
            if lone and 0 < at < len(controls) - 1 and _repeated_around(controls, at, repeats):
                found.setdefault(c, set()).add(at)
    for c, places in sorted(found.items()):
        yield "the command %s is %s, one bit away from its repetition: the bag may be damaged" % (
            channels[c],
            " and ".join(
                "%g at %.2f s" % (controls[at, c], times[at] - times[0]) for at in sorted(places)
            ),
        )


def _one_bit_apart(controls: Array) -> Tuple[Indices, Indices]:
    """Messages that differ from the next one by one bit of a channel, and so much that it matters: their
    indices and those of the channels."""
    bits = np.ascontiguousarray(controls, float).view(np.uint64)
    differ = bits[1:] ^ bits[:-1]
    one = (differ & (differ - np.uint64(1))) == 0
    one &= np.abs(np.diff(controls, axis=0)) > MIN_CHANGE
    alone = (differ != 0).sum(axis=1) == 1
    before, channel = np.nonzero(one & alone[:, None])
    return before, channel


def _repeated_around(controls: Array, at: int, repeats: int) -> bool:
    """Whether all commands around one of them are held for several messages, if this one repeats its
    neighbour; a recording may begin and end with any."""
    mended = controls.copy()
    mended[at] = controls[repeats]
    changes = np.flatnonzero((mended[1:] != mended[:-1]).any(axis=1)) + 1
    held = np.diff(changes)
    place = int(np.searchsorted(changes, at, side="right")) - 1
    near = held[max(place - REPEATED, 0) : place + REPEATED + 1]
    return len(near) > 0 and bool(near.min() > 1)


def _bits(stamps: Array, bit: Indices) -> Flags:
    """Whether each stamp (n,) [s] has its bit, an index of STAMP_BITS, set."""
    seconds = np.floor(stamps + 0.5 * RESOLUTION).astype(np.int64)
    nanoseconds = np.round(1e9 * np.maximum(stamps - seconds, 0)).astype(np.int64)
    part = np.where(bit < BITS, nanoseconds, seconds)
    return np.asarray(part >> (bit % BITS) & 1 == 1)


def _neighbours(count: int) -> Indices:
    """Indices (count, 2 * NEIGHBOURS) of the neighbours of each of `count` messages."""
    first = np.clip(np.arange(count) - NEIGHBOURS, 0, count - 2 * NEIGHBOURS - 1)
    window = first[:, None] + np.arange(2 * NEIGHBOURS + 1)
    others = window != np.arange(count)[:, None]
    return np.asarray(window[others].reshape(count, 2 * NEIGHBOURS))
