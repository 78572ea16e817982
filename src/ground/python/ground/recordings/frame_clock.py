"""The clock of a motion capture's frames, rebuilt from late stamps and the motion itself.

A client that polls stamps every frame with the instant at which it came to fetch it: frames of one
poll share a stamp, frames that the network held up come late all together. But frames are taken at a
constant rate, and while the craft moves each step says how many frames it took. A client that is told
of each frame stamps most of them well, and those that come in a burst late. The most likely
numbers of the frames (Viterbi 1967) given both put every pose back to its instant.
"""

from dataclasses import dataclass
from typing import Optional, Tuple, Union

import numpy as np

from ground.annotations import Array, Flags, Indices

NOISE = np.array([4e-4, 4e-4, 6e-3])  # of one pose: x, y [m], psi [rad]
LATEST = 0.4  # a frame is not stamped later than this after the poll that might have had it [s]
EARLIEST = 1e-3  # what the clock itself may be off [s]
SCATTER = 0.25  # of the steps in frames: intervals that vary more are not those of the frames
IRREGULAR = 0.02  # of the intervals, from which on the clock is looked for
SMOOTHER = 0.7  # the motion by its instants has to be, relative to that by the stamps
MOVES = 4.0  # steps above this many noises tell how many frames they took
MOST_LOST = 12  # frames in a row that a step can tell
UNLIKELY = 12.0  # log-likelihood that no single step or stamp may cost more than
LOSS = 3.0  # log-likelihood of a lost frame against none


@dataclass
class FrameClock:
    """Instants of the poses, and what the stamps were like."""

    times: Array  # (n,) of the frames, on the clock of the stamps, as if fetched at once [s]
    rate: float  # of the frames [1/s]
    lost: int  # frames between the first and the last that are not there
    lateness: Array  # (n,) of the stamps after the frames [s]
    roughness: float  # of the motion by the new instants, relative to that by the stamps


def rebuild(times: Array, eta: Array) -> Optional[FrameClock]:
    """The frame clock of poses with stamps `times` (n,) [s], not descending, and `eta` (n, 3).

    Returns None where there is none to be found: stamps that are regular already, too little motion,
    or motion that the clock found makes no smoother.
    """
    if len(times) < 200 or not _irregular(times):
        return None
    steps = np.diff(eta, axis=0) / (np.sqrt(2) * NOISE)
    numbers, tell = _numbers_by_motion(steps)
    if tell.mean() < 0.3:
        return None
    rate = _rate(times, numbers)
    start = float(times[0])
    for _ in range(3):
        single = _single_steps(steps, np.diff(numbers))
        numbers = _most_likely(times, steps, single, rate, start)
        start, rate = _line(times, numbers)
    frames = start + numbers / rate
    roughness = _roughness(frames, eta) / _roughness(times, eta)
    if not roughness < SMOOTHER:
        return None
    return FrameClock(
        frames, rate, int(numbers[-1] - numbers[0] + 1 - len(times)), times - frames, roughness
    )


def _irregular(times: Array) -> bool:
    steps = np.diff(times)
    middle = np.median(steps)
    return bool(middle <= 0 or np.mean(np.abs(steps - middle) > SCATTER * middle) > IRREGULAR)


def _numbers_by_motion(steps: Array) -> Tuple[Indices, Flags]:
    """Numbers of the poses' frames as the motion alone tells them, and which steps do tell."""
    single = _single_steps(steps, np.ones(len(steps)))
    size = np.linalg.norm(single, axis=1)
    counts = 1 + np.argmin(_step_costs(steps, single), axis=1)
    tell = size > MOVES
    return np.concatenate([[0], np.cumsum(np.where(tell, counts, 1))]), tell


def _single_steps(steps: Array, counts: Union[Array, Indices]) -> Array:
    """What the craft moves from one frame to the next, near every step: medians of nine."""
    padded = np.pad(steps / counts[:, None], ((4, 4), (0, 0)), mode="edge")
    return np.asarray(np.median(np.stack([padded[i : i + len(steps)] for i in range(9)]), axis=0))


def _step_costs(steps: Array, single: Array) -> Array:
    """Minus log-likelihood of each step taking 1, 2, … frames, (n - 1, MOST_LOST + 1)."""
    counts = np.arange(1, MOST_LOST + 2)
    expected = counts[None, :, None] * single[:, None, :]
    # The motion changes from step to step: by less than a tenth over one frame.
    variance = 1 + (0.1 * counts[None, :, None]) ** 2 * (1 + single[:, None, :] ** 2 / 10)
    misfit = ((steps[:, None, :] - expected) ** 2 / variance).sum(axis=2) / 2
    return np.asarray(np.minimum(misfit, UNLIKELY))


def _rate(times: Array, numbers: Indices, block: int = 60) -> float:
    """Frames per second: how fast the earliest stamps of each block advance."""
    rate = len(times) / (times[-1] - times[0])
    for _ in range(3):
        late = times - numbers / rate
        firsts = [
            i + int(np.argmin(late[i : i + block])) for i in range(0, len(times) - block, block)
        ]
        # Gaps make single blocks late, never early: the median is that of whole blocks.
        rate = 1 / np.median(np.diff(times[firsts]) / np.diff(numbers[firsts]))
    return float(rate)


def _late_cost(late: Union[float, Array], poll: float) -> Array:
    """Minus log-likelihood of a stamp so late [s]: up to a poll's period all are alike."""
    cost = np.where(late < poll, 0.0, 2 + 2 * np.log1p(np.maximum(late - poll, 0) / poll))
    return np.where(late < -EARLIEST, UNLIKELY - 1e3 * late, cost)


def _most_likely(times: Array, steps: Array, single: Array, rate: float, start: float) -> Indices:
    """The frames' numbers that stamps and steps together make most likely."""
    intervals = np.diff(times)
    poll = 1.2 * max(np.median(intervals[intervals > 1e-3]), 1 / rate)
    newest = np.floor((times - start + EARLIEST) * rate).astype(int)
    depth = int(LATEST * rate)
    behind = np.arange(depth)  # how many frames a pose is older than the newest at its stamp
    gone = behind[:, None] - behind[None, :]  # rows: pose before, columns: this pose
    by_step = _step_costs(steps, single)
    longest = MOST_LOST + 1
    by_count = np.concatenate([[0.0], LOSS + np.log(np.arange(1, 20000))])
    cost = _late_cost(times[0] - start - (newest[0] - behind) / rate, poll)
    came_from = np.zeros((len(times), depth), int)
    for k in range(1, len(times)):
        count = newest[k] - newest[k - 1] + gone
        possible = count >= 1
        count = np.clip(count, 1, len(by_count))
        here = by_count[count - 1] + np.where(
            count <= longest, by_step[k - 1][np.minimum(count, longest) - 1], UNLIKELY / 2
        )
        total = np.where(possible, cost[:, None] + here, np.inf)
        came_from[k] = np.argmin(total, axis=0)
        late = times[k] - start - (newest[k] - behind) / rate
        cost = total[came_from[k], behind] + _late_cost(late, poll)
    at = int(np.argmin(cost))
    numbers = np.empty(len(times), int)
    for k in range(len(times) - 1, -1, -1):
        numbers[k] = newest[k] - behind[at]
        at = came_from[k, at]
    return numbers


def _line(times: Array, numbers: Indices, block: int = 60) -> Tuple[float, float]:
    """Start [s] and rate [1/s] of the clock on which the earliest stamps are not late."""
    from scipy import stats  # slow to load, and few recordings need it

    slope = (times[-1] - times[0]) / (numbers[-1] - numbers[0])
    late = times - slope * numbers
    firsts = np.array(
        [i + int(np.argmin(late[i : i + block])) for i in range(0, len(times), block)]
    )
    slope = stats.theilslopes(times[firsts], numbers[firsts])[0]
    start = np.quantile((times - slope * numbers)[firsts], 0.2)
    return start, 1 / slope


def _roughness(times: Array, eta: Array) -> float:
    """Mean change of velocity from step to step, in noises, where the steps take time."""
    apart = np.maximum(np.diff(times), 2e-3)[:, None]
    change = np.diff(np.diff(eta, axis=0) / apart, axis=0) / NOISE
    return float(np.mean(np.linalg.norm(change, axis=1)))
