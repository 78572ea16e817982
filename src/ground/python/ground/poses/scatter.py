"""Scales of a recording that follow from its poses: their interval, their noise, the jerk of the motion.

Nothing here is a number of a craft. A coordinate is taken for an integrated random walk (white jerk) seen
with white noise. The levels of both under which the poses are likeliest distinguish noise from motion at
any rate of the poses: third differences do so only where little happens within an interval.
"""

from typing import Callable, Optional, Sequence, Tuple, Union

import numpy as np

from ground import _core
from ground.support.annotations import Array, Flags, Indices

Levels = Tuple[float, float]  # of positions, and of headings

BRIDGED = 12.0  # longest gap [usual intervals]
LEAST_BRIDGED = 2.5  # the same where the craft turns so fast that its heading would be ambiguous
SOUND, SHORT = 13, 5  # steps in a row whose median is a velocity of the craft
FINEST = np.array([1e-6, 1e-6, 1e-6])  # least noise relative to the range of x, y, heading
MOST_SAMPLES, PIECE = 8000, 1000  # poses from which levels are estimated, in all and in one piece
MOTION = 0.55  # variance of third differences of an integrated random walk [jerk^2 interval^5]
SMALL = 0.5  # part of motion in third differences up to which these are noise ...
WIDTHS, LARGE = (5, 3), 2.0  # ... and up to which medians of so many poses give the jerk
WOBBLE = 1.3  # ... where poses are off by so many times their noise from frame to frame
MOSTLY = 0.5  # least share of evenly spaced poses for third differences
ROUNDED = np.array([1.0, 2.0, 5.0, 10.0])  # jerks are these times a power of ten
FACTOR, PRECISE = 10.0, 1.02  # first and last steps of the search for the likeliest levels
MIN_POSES = 50  # poses from which levels are estimated


def interval(times: Array) -> float:
    """The usual time between poses with ascending stamps (n,) [s]; stamps of a burst count as one."""
    steps = np.diff(times)
    steps = steps[steps > 0.1 * np.quantile(steps, 0.9)] if len(steps) else steps
    return float(np.median(steps)) if len(steps) else 1.0


def around(rows: Union[Array, Indices, Flags], count: int) -> Array:
    """For each of the rows (n, ...) it and so many on either side, (n, m, ...); at the ends those within."""
    width = min(2 * count + 1, len(rows))
    first = np.clip(np.arange(len(rows)) - count, 0, len(rows) - width)
    return np.asarray(rows[first[:, None] + np.arange(width)])


def running_median(rows: Array, count: int) -> Array:
    """At each of the rows (n, ...) the medians of it and of so many on either side."""
    return np.asarray(np.median(around(rows, count), axis=1))


def largest_speeds(times: Array, eta: Array) -> Levels:
    """The largest speed [m/s] and yaw rate [rad/s] of poses eta (n, 3) with ascending stamps (n,) [s], which
    last for SOUND intervals or are usual over a few, by medians that few wrong poses or stamps do not
    change; at least one rounding of the poses per interval."""
    usual = interval(times)
    steps = np.diff(eta, axis=0)[np.diff(times) < LEAST_BRIDGED * usual]
    if not len(steps):
        return 1e-9, 1e-9
    lasting, short = (np.abs(running_median(steps, count // 2)) for count in (SOUND, SHORT))
    fastest = np.maximum(lasting.max(axis=0), np.quantile(short, 0.95, axis=0))
    fastest = np.maximum(fastest, np.sqrt(12) * resolution(eta)) / usual
    return float(fastest[:2].max()), float(fastest[2])


def longest_gap(times: Array, fastest: float) -> float:
    """The longest gap between poses that is bridged [s], by their stamps (n,) [s] and the largest yaw rate
    [rad/s]: some intervals, but not so many that the craft may turn round unseen."""
    usual = interval(times)
    return float(np.clip(np.pi / fastest, LEAST_BRIDGED * usual, BRIDGED * usual))


def resolution(values: Array) -> Array:
    """The least noise that columns (n, 3) can have, because they are rounded."""
    finest = FINEST * np.maximum(np.ptp(values, axis=0), 1e-6)
    for i, column in enumerate(values.T):
        steps = np.abs(np.diff(column))
        steps = steps[steps > finest[i]]
        if len(steps):
            finest[i] = max(finest[i], _quantum(steps) / np.sqrt(12))
    return np.asarray(finest)


def _quantum(steps: Array) -> float:
    """The rounding of which steps (n,) are multiples; 0 without one."""
    least = float(np.quantile(steps, 0.01))
    multiples = steps[: 20 * MIN_POSES] / least
    return least if np.median(np.abs(multiples - np.round(multiples))) < 0.02 else 0.0


def in_order(poses: Array) -> Array:
    """Scatter (3,) of the third differences of poses (n, 3) in their order, whatever their stamps: their
    noise, as long as the craft moves evenly from pose to pose."""
    third = np.abs(np.diff(poses, 3, axis=0))
    found = 1.4826 * np.median(third, axis=0) / np.sqrt(20) if len(third) else np.zeros(3)
    found[:2] = np.hypot(*found[:2]) / np.sqrt(2)
    return np.asarray(np.maximum(found, resolution(poses)))


def third_differences(times: Array, poses: Array) -> Optional[Array]:
    """Scatter (3,) of the third differences of poses (n, 3) with ascending stamps (n,) [s] where these are
    evenly spaced: the standard deviations of x, y and heading if little happens within an interval. None
    where few are."""
    even = _even(times)
    if even.sum() < MIN_POSES or even.mean() < MOSTLY:
        return None
    third = np.abs(np.diff(poses, 3, axis=0)[even])
    return np.asarray(1.4826 * np.median(third, axis=0) / np.sqrt(20))


def _even(times: Array) -> Flags:
    steps = np.diff(times)
    even = np.abs(steps - np.median(steps)) < 0.2 * np.median(steps)
    return np.asarray(even[:-2] & even[1:-1] & even[2:])


def levels(times: Array, poses: Array, max_gap: float, speeds: Levels) -> Tuple[Levels, Levels, float]:
    """Standard deviations of the noise of poses (n, 3) with ascending stamps (n,) [s], of positions [m] and
    headings [rad]; root densities of the jerk by which they are smoothed [m/s^2.5], [rad/s^2.5]; and how
    many times as far as their noise poses are off where they wobble from frame to frame together. speeds:
    largest ones of the craft [m/s], [rad/s]."""
    least, usual = resolution(poses), interval(times)
    third = third_differences(times, poses)
    guess = in_order(poses) if third is None else third
    some = _pieces(len(times))
    found, excess = [], 1.0
    for columns, speed in zip(([0, 1], [2]), speeds):
        own = float(np.hypot.reduce(guess[columns]) / np.sqrt(len(columns)))
        finest = float(least[columns].max())
        own, samples = max(own, finest), poses[some][:, columns]
        noise, jerk = _likeliest(times[some], samples, max_gap, own, finest, speed)

        def motion(width: int, jerk: float = jerk, own: float = own) -> float:
            """Variance of third differences of poses that are `width` apart by motion, over that by noise."""
            return MOTION * jerk**2 * (width * usual) ** 5 / (20 * own**2)

        wobble = 1.0
        # Vibration and a camera's wobble add to what is likeliest, but not from frame to frame.
        if third is not None and motion(1) < SMALL:
            wobble, noise = noise / own, own
            excess = max(excess, wobble)
        width = next((width for width in WIDTHS if motion(width) < LARGE), 1)
        if wobble > WOBBLE and width > 1 and len(some) > MIN_POSES * width:
            medians = _medians(times[some], samples, width)
            jerk = _likeliest(*medians, width * max_gap, own / np.sqrt(width), 0.1 * finest, speed)[1]
        found.append((noise, _rounded(jerk)))
    (position, linear), (heading, angular) = found
    return (position, heading), (linear, angular), excess


def _medians(times: Array, columns: Array, width: int) -> Tuple[Array, Array]:
    """Mean times (m,) and medians (m, k) of so many poses in a row."""
    count = len(times) // width * width
    stamps = times[:count].reshape(-1, width)
    together = np.ptp(stamps, axis=1) < 2 * width * interval(times)
    medians = np.median(columns[:count].reshape(-1, width, columns.shape[1]), axis=1)
    return stamps.mean(axis=1)[together], medians[together]


def _pieces(count: int) -> Sequence[int]:
    """Samples in pieces that are spread over `count` of them."""
    if count <= MOST_SAMPLES:
        return list(range(count))
    begins = np.linspace(0, count - PIECE, MOST_SAMPLES // PIECE).astype(int)
    return [i for begin in begins for i in range(begin, begin + PIECE)]


def _likeliest(
    times: Array, columns: Array, max_gap: float, noise: float, least: float, speed: float
) -> Levels:
    """The noise, not below `least`, and the jerk under which columns (n, k) are likeliest."""
    speed = max(speed, noise)
    rows = [np.ascontiguousarray(column) for column in columns.T]
    stamps = list(times)

    def likelihood(at: Array) -> float:
        one, jerk = np.exp(at)
        return sum(_core.motion_likelihood(stamps, row, one, jerk, max_gap, speed) for row in rows)

    usual = interval(times)
    first = np.array([noise, max(noise / usual**2.5, 1e-6 * speed)])
    low = np.log(np.array([least, 1e-6 * first[1]]))
    return _climb(likelihood, np.maximum(np.log(first), low), low)


def _climb(value: Callable[[Array], float], start: Array, low: Array) -> Levels:
    """The point of a largest value, by steps along each axis that shrink; exp of it."""
    at, best, step = start, value(start), np.log(FACTOR)
    while step > np.log(PRECISE):
        before = best
        for direction in np.vstack([np.eye(2), -np.eye(2)]):
            tried = np.maximum(at + step * direction, low)
            found = value(tried)
            if found > best + 1e-9:
                at, best = tried, found
        if best <= before:
            step /= 3
    noise, jerk = np.exp(at).tolist()
    return noise, jerk


def _rounded(jerk: float) -> float:
    """The nearest of ROUNDED times a power of ten: all runs of a craft have nearly the same."""
    power = 10.0 ** np.floor(np.log10(jerk))
    return float(power * ROUNDED[np.argmin(np.abs(np.log(power * ROUNDED / jerk)))])
