"""The clock of a motion capture's frames, rebuilt from late stamps and the motion itself.

A polling client stamps every frame with the instant at which it fetched it: frames of one poll share a
stamp, and frames that the network delayed arrive together. A client that gets each frame stamps most
frames well, but stamps the frames of a delayed burst late. The camera takes frames at a constant rate, and
while the craft moves, the size of a step shows how many frames it took. The most likely frame numbers
given both (Viterbi 1967) put every pose back to its instant.
"""

from dataclasses import dataclass
from typing import Iterable, Iterator, Optional, Tuple, Union

import numpy as np

from ground.support.annotations import Array, Flags, Indices

LATEST = 0.4  # largest delay of a frame after the first poll that might have fetched it [s]
EARLIEST = 1e-3  # error of the clock itself [s]
SCATTER = 0.25  # relative deviation of an interval from which it is irregular
IRREGULAR = 0.02  # share of irregular intervals from which the clock is rebuilt
SMOOTHER = 0.7  # largest roughness of the motion by the new instants, relative to that by the stamps
MIN_TELLING = 0.1  # least share of steps that show how many frames they took
# Tried standard deviations of a pose with its wobble, relative to its noise from frame to frame
WIDTHS = (1.4, 2.0, 2.8)
AGREE = 1.002  # largest ratio of the rates by these, above which further rates are tried
# Numbers of poses, and ratios of rates that are tried by them: the more poses, the narrower is the peak
RATES = (
    (400, np.arange(0.95, 1.4, 0.01)),
    (400, np.arange(0.985, 1.016, 0.0025)),
    (2000, np.arange(0.9992, 1.0009, 0.0002)),
)
PARTS = 10  # of a recording, in each of which the earliest stamp is not late
MIN_MOVE = 4.0  # a step above this many standard deviations shows how many frames it took
MAX_LOST = 12  # lost frames in a row that a step can show
MAX_COST = 12.0  # largest cost of a single step or stamp [log-likelihood]
TOGETHER = 4096  # poses whose costs are computed at a time
LOSS_COST = 3.0  # cost of a lost frame [log-likelihood]

Clock = Tuple[float, float, Indices]  # start [s], rate [Hz], numbers of the frames (n,)


@dataclass
class FrameClock:
    """Instants of the poses, and the errors of the stamps."""

    times: Array  # (n,) instants of the frames, on the clock of the stamps, if fetched at once [s]
    rate: float  # frame rate [1/s]
    lost: int  # missing frames between the first and the last
    lateness: Array  # (n,) delays of the stamps after the frames [s]


def rebuild(
    times: Array, eta: Array, noise: Array, known_rate: Optional[float] = None
) -> Optional[FrameClock]:
    """The frame clock of poses with stamps `times` (n,) [s], not descending, and `eta` (n, 3) of noise (3,).

    known_rate: of the frames [Hz], else what stamps and motion say. Returns None if the stamps are regular
    already, if there is too little motion, or if the new instants do not make the motion smoother.
    """
    if len(times) < 200 or not _irregular(times):
        return None

    def roughness(one: Clock) -> float:
        """Relative to that by the stamps."""
        start, rate, numbers = one
        by_stamps = max(_roughness(times, eta / noise, 1 / rate), 1e-300)
        return _roughness(start + numbers / rate, eta[: len(numbers)] / noise, 1 / rate) / by_stamps

    alone = _without_loss(times)
    tried = (_with_losses(times, eta, wide * noise, known_rate) for wide in WIDTHS)
    clocks = [alone] if alone else [clock for clock in tried if clock]
    if not clocks:
        return None
    best = min(clocks, key=roughness)
    rates = [rate for _, rate, _ in clocks]
    if max(rates) > AGREE * min(rates) and known_rate is None:
        other = _by_rates(times, eta, WIDTHS[0] * noise, max(rates))
        best = other if other and roughness(other) < SMOOTHER else best
    if not roughness(best) < SMOOTHER and known_rate is None:
        return None
    start, rate, numbers = best
    rate = known_rate or rate
    frames = start + numbers / rate
    return FrameClock(frames, rate, int(numbers[-1] - numbers[0] + 1 - len(times)), times - frames)


def _without_loss(times: Array) -> Optional[Clock]:
    """The Clock if the order of the poses alone gives it, because no frame is lost: the earliest stamps are
    not late in any part of the recording."""
    numbers = np.arange(len(times))
    start, rate = _line(times, numbers)
    late = times - start - numbers / rate
    soon = 2 * max(1 / rate, float(np.median(np.diff(times))))
    if late.min() < -soon or max(part.min() for part in np.array_split(late, PARTS)) > soon:
        return None
    return start, rate, numbers


def _with_losses(times: Array, eta: Array, noise: Array, known_rate: Optional[float]) -> Optional[Clock]:
    """The Clock of the most likely frame numbers given stamps and steps; None where the motion is too small
    for it."""
    steps = np.diff(eta, axis=0) / (np.sqrt(2) * noise)
    numbers, tell = _numbers_by_motion(steps)
    if tell.mean() < MIN_TELLING and known_rate is None:
        return None
    start, rate = float(times[0]), known_rate or _rate(times, numbers)
    for _ in range(3):
        single = _single_steps(steps, np.maximum(np.diff(numbers), 1))
        numbers = _most_likely(times, steps, single, rate, start)
        start, rate = _line(times, numbers)
    return start, rate, numbers


def _by_rates(times: Array, eta: Array, noise: Array, rate: float) -> Optional[Clock]:
    """The Clock of the likeliest rate around one [Hz] that losses of frames may have made too low."""
    for count, ratios in RATES:
        first = int(np.argmin(times[count:] - times[:-count])) if len(times) > count else 0
        some = slice(first, first + count)
        tried = (_with_losses(times[some], eta[some], noise, one) for one in rate * ratios)
        costs = [(_cost(times[some], eta[some], noise, clock), clock[1]) for clock in tried if clock]
        rate = min(costs, default=(0.0, rate))[1]
    return _with_losses(times, eta, noise, rate)


def _cost(times: Array, eta: Array, noise: Array, clock: Clock) -> float:
    """Minus log-likelihood of stamps, steps and losses of frames by a Clock, for each pose."""
    start, rate, numbers = clock
    steps, counts = np.diff(eta, axis=0) / (np.sqrt(2) * noise), np.clip(np.diff(numbers), 1, MAX_LOST + 1)
    by_step = _step_costs(steps, _single_steps(steps, counts))[np.arange(len(counts)), counts - 1]
    by_loss = np.where(counts > 1, LOSS_COST + np.log(np.maximum(counts - 1, 1)), 0.0)
    late = _late_cost(times - start - numbers / rate, _poll(times, rate))
    return float((by_step + by_loss).mean() + late.mean())


def _irregular(times: Array) -> bool:
    steps = np.diff(times)
    middle = np.median(steps)
    return bool(middle <= 0 or np.mean(np.abs(steps - middle) > SCATTER * middle) > IRREGULAR)


def _numbers_by_motion(steps: Array) -> Tuple[Indices, Flags]:
    """Frame numbers of the poses by the motion alone, and which steps are large enough for that."""
    single = _single_steps(steps, np.ones(len(steps)))
    size = np.linalg.norm(single, axis=1)
    counts = 1 + np.argmin(_step_costs(steps, single), axis=1)
    tell = size > MIN_MOVE
    return np.concatenate([[0], np.cumsum(np.where(tell, counts, 1))]), tell


def _single_steps(steps: Array, counts: Union[Array, Indices]) -> Array:
    """Motion of the craft from one frame to the next near every step, as medians of nine."""
    padded = np.pad(steps / counts[:, None], ((4, 4), (0, 0)), mode="edge")
    return np.asarray(np.median(np.stack([padded[i : i + len(steps)] for i in range(9)]), axis=0))


def _step_costs(steps: Array, single: Array) -> Array:
    """Minus log-likelihood of each step taking 1, 2, … frames, (n - 1, MAX_LOST + 1)."""
    counts = np.arange(1, MAX_LOST + 2)
    expected = counts[None, :, None] * single[:, None, :]
    # The motion changes by less than a tenth from one frame to the next.
    variance = 1 + (0.1 * counts[None, :, None]) ** 2 * (1 + single[:, None, :] ** 2 / 10)
    misfit = ((steps[:, None, :] - expected) ** 2 / variance).sum(axis=2) / 2
    return np.asarray(np.minimum(misfit, MAX_COST))


def _rate(times: Array, numbers: Indices, block: int = 60) -> float:
    """Frames per second, by the earliest stamps of each block."""
    rate = len(times) / (times[-1] - times[0])
    for _ in range(3):
        late = times - numbers / rate
        firsts = [i + int(np.argmin(late[i : i + block])) for i in range(0, len(times) - block, block)]
        # A gap makes a block late, never early, and does not affect the median.
        rate = 1 / np.median(np.diff(times[firsts]) / np.diff(numbers[firsts]))
    return float(rate)


def _late_cost(late: Union[float, Array], poll: float) -> Array:
    """Minus log-likelihood of a stamp's delay [s]: delays up to a poll's period cost the same."""
    cost = np.where(late < poll, 0.0, 2 + 2 * np.log1p(np.maximum(late - poll, 0) / poll))
    return np.where(late < -EARLIEST, MAX_COST - 1e3 * late, cost)


def _poll(times: Array, rate: float) -> float:
    """Longest usual time between polls of a client by its stamps (n,) and the rate of the frames [s]."""
    intervals = np.diff(times)
    return float(1.2 * max(np.median(intervals[intervals > EARLIEST]), 1 / rate))


def _most_likely(times: Array, steps: Array, single: Array, rate: float, start: float) -> Indices:
    """The most likely frame numbers given stamps and steps."""
    poll = _poll(times, rate)
    newest = np.floor((times - start + EARLIEST) * rate).astype(int)
    depth = max(2, int(LATEST * rate))
    behind = np.arange(depth)  # number of frames by which a pose is older than the newest at its stamp
    gone = behind[:, None] - behind[None, :]  # rows: pose before, columns: this pose
    every = np.arange(gone.min(), gone.max() + 1)
    at = gone - every[0]  # in `every`
    by_step = _step_costs(steps, single)
    longest = MAX_LOST + 1
    by_count = np.concatenate([[0.0], LOSS_COST + np.log(np.arange(1, 20000))])

    def late(some: Indices) -> Array:
        """Costs of some poses (m, depth)."""
        return _late_cost(times[some, None] - start - (newest[some, None] - behind[None, :]) / rate, poll)

    def steps_to(some: Indices) -> Array:
        """Costs of the steps to some poses by each number of `every` (m, 2 depth - 1)."""
        count = (newest[some] - newest[some - 1])[:, None] + every[None, :]
        possible = count >= 1
        count = np.clip(count, 1, len(by_count))
        shown = np.take_along_axis(by_step[some - 1], np.minimum(count, longest) - 1, axis=1)
        by_motion = np.where(count <= longest, shown, MAX_COST / 2)
        return np.where(possible, by_count[count - 1] + by_motion, np.inf)

    def later() -> Iterator[Tuple[Array, Array]]:
        for begin in range(1, len(times), TOGETHER):
            some = np.arange(begin, min(begin + TOGETHER, len(times)))
            for step, own in zip(steps_to(some), late(some)):
                yield step[at], own

    return np.asarray(newest - likeliest(late(np.array([0]))[0], later()))


def likeliest(first: Array, later: Iterable[Tuple[Array, Array]]) -> Indices:
    """The likeliest sequence of states (n,) (Viterbi 1967). first: costs of the first state (s,); later:
    costs from state to state (s, s), and of the state (s,), minus log-likelihoods."""
    cost, came_from = first, []
    for step, own in later:
        total = cost[:, None] + step
        came_from.append(np.argmin(total, axis=0))
        cost = total[came_from[-1], np.arange(len(cost))] + own
    states = [int(np.argmin(cost))]
    for before in reversed(came_from):
        states.append(int(before[states[-1]]))
    return np.array(states[::-1])


def _line(times: Array, numbers: Indices, block: int = 60) -> Tuple[float, float]:
    """Start [s] and rate [1/s] of the clock by which the earliest stamps are not late."""
    from scipy import stats  # slow to load, and few recordings need it

    slope = (times[-1] - times[0]) / (numbers[-1] - numbers[0])
    late = times - slope * numbers
    firsts = np.array([i + int(np.argmin(late[i : i + block])) for i in range(0, len(times), block)])
    slope = stats.theilslopes(times[firsts], numbers[firsts])[0]
    start = np.quantile((times - slope * numbers)[firsts], 0.2)
    return start, 1 / slope


def _roughness(times: Array, places: Array, interval: float) -> float:
    """Mean change of velocity from step to step. places: poses in standard deviations; interval: between
    frames [s]."""
    apart = np.maximum(np.diff(times), 0.25 * interval)[:, None]
    change = np.diff(np.diff(places, axis=0) / apart, axis=0)
    return float(np.mean(np.linalg.norm(change, axis=1)))
