"""Patterns in what a model leaves, which a random disturbance does not have.

The innovations of a filter are white if the model and its disturbance are true (Kailath 1968): no frequency
stands out in them. What runs with the same commands have in common is not random.
"""

import itertools
from dataclasses import dataclass
from typing import List, NamedTuple, Sequence, Tuple

import numpy as np

from ground import _core
from ground.analysis import residuals
from ground.analysis.likelihood import Fit, Likelihood
from ground.recordings import scatter
from ground.support.annotations import Array, Flags

ALIKE = 0.9  # least correlation of commands that count as the same: edges are some milliseconds apart
MIN_PERIODS = 2  # of the lowest frequency, in a run of usual length
FINEST = 10.0  # periods of the highest frequency in a horizon: faster pushes hardly move a craft in it
MOST_PAIRS = 20


@dataclass(frozen=True)
class Band:
    """Frequencies at which a line may stand out, of rows on a grid of time."""

    step: float  # [s]
    count: int  # of the grid, zeros at its end included
    inside: Flags  # which of its frequencies

    @property
    def rates(self) -> Array:
        """The frequencies [Hz]."""
        return np.asarray(np.fft.rfftfreq(self.count, self.step)[self.inside])

    def power(self, times: Array, rows: Array) -> Array:
        """Power (k, n) at the frequencies of rows (m, n) at some times, relative to that of white ones."""
        at = np.round((times - times[0]) / self.step).astype(int)
        grid = np.zeros((self.count, rows.shape[1]))
        np.add.at(grid, at, rows)
        return np.asarray(np.abs(np.fft.rfft(grid, axis=0)[self.inside]) ** 2 / max(1, len(times)))


class Pair(NamedTuple):
    """Two runs in which the same commands were given."""

    first: int
    second: int
    shift: float  # time of the second one less that of the first one, of the same command [s]


@dataclass(frozen=True)
class Seen:
    """What the filter sees in the poses of some runs."""

    wrenches: List[Array]  # of the disturbance, relative to its rms in the run, X, Y, N, (n, 3)
    lines: Array  # power of the innovations in a Band, relative to its median, body and room, (k, 2)
    common: float  # correlation of the wrench in pairs of runs; 0 without any

    @property
    def numbers(self) -> List[float]:
        """What is compared: the larger, the less like a random disturbance. The logarithms of the kurtosis of
        the wrench, as a push at some times or places only has heavy tails, and of the power of the strongest
        line in the body frame and in the room; and the correlation."""
        tails = (np.concatenate(self.wrenches) ** 4).mean(axis=0)
        return [*np.log(tails), *np.log(self.lines.max(axis=0)), self.common]


def seen(likelihood: Likelihood, fit: Fit, band: Band, pairs: Sequence[Pair]) -> Seen:
    """What the filter of a Fit sees in the runs of a Likelihood, without inertial samples."""
    wrenches, power = [], np.zeros((len(band.rates), 5))
    for i, run in enumerate(likelihood.runs):
        left = likelihood.residuals(fit.point, i)
        wrench = np.array(left["wrench"])
        wrenches.append(wrench / np.maximum(np.sqrt((wrench**2).mean(axis=0)), 1e-30))
        scored = np.array(left["scored"], bool)
        if not scored.any():
            continue
        # The innovations of positions, x and y, are independent and of variance one; so they are when turned.
        x, y, turn = np.array(left["whitened"])[scored, :3].T
        c, s = np.cos(np.array(run.eta)[scored, 2]), np.sin(np.array(run.eta)[scored, 2])
        rows = np.column_stack([c * x + s * y, c * y - s * x, turn, x, y])
        rows = (rows - rows.mean(axis=0)) / np.maximum(rows.std(axis=0), 1e-30)
        power += band.power(np.array(run.times)[scored], rows)
    lines = np.column_stack([power[:, :3].sum(axis=1), power[:, 3:].sum(axis=1)])
    common = []
    for pair in pairs:
        both = [
            np.column_stack([np.interp(at, np.array(likelihood.runs[k].times), w) for w in wrenches[k].T])
            for k, at in _together(likelihood.runs, pair)
        ]
        common.append(alike(both[:1], both[1:]))
    lines = lines / np.maximum(np.median(lines, axis=0), 1e-300)
    return Seen(wrenches, lines, float(np.mean(common)) if common else 0.0)


def band(runs: Sequence[_core.RunData], seconds: float) -> Band:
    """The Band of runs; seconds: horizon of predictions."""
    durations = [run.times[-1] - run.times[0] for run in runs]
    steps = [scatter.interval(np.array(run.times)) for run in runs]
    # twice as fine as the longest run
    count = 2 ** int(np.ceil(np.log2(2 * max(durations) / min(steps) + 2)))
    rates = np.fft.rfftfreq(count, min(steps))
    lowest = MIN_PERIODS / max(float(np.median(durations)), 1e-9)
    highest = max(min(FINEST / seconds, 0.4 / max(steps)), 2 * lowest)
    inside = (rates >= lowest) & (rates <= highest)
    inside[-1] |= not inside.any()  # of a run that is too short for a line
    return Band(min(steps), count, inside)


def pairs(runs: Sequence[_core.RunData]) -> List[Pair]:
    """The Pairs of runs that were given the same commands, from their first change on; MOST_PAIRS of many."""
    begins, found = [_driven(run)[0] for run in runs], []
    for i, j in itertools.combinations(range(len(runs)), 2):
        pair = Pair(i, j, begins[j] - begins[i])
        given = [residuals.held(runs[k], at)[:, :-1] for k, at in _together(runs, pair)]
        a, b = ((one - one.sum(axis=0) / max(1, len(one))).ravel() for one in given)
        if float(a @ b) > ALIKE * max(float(a @ a), float(b @ b), 1e-300):
            found.append(pair)
    return found[:: 1 + max(0, len(found) - 1) // MOST_PAIRS]


def _driven(run: _core.RunData) -> Tuple[float, float]:
    """Times of the first change of a command, and of the end of thrust [s]."""
    inputs = np.array(run.inputs)
    changes = np.flatnonzero((inputs[1:, 1:-1] != inputs[:-1, 1:-1]).any(axis=1)) + 1
    if not len(changes):
        return run.times[0], run.times[-1]
    ends = run.times[-1] if inputs[-1, 1:-1].any() else inputs[changes[-1], 0]
    return float(inputs[changes[0], 0]), float(ends)


def _together(runs: Sequence[_core.RunData], pair: Pair) -> List[Tuple[int, Array]]:
    """Both runs of a pair, and times of each in which both are driven; a wall may have ended one earlier."""
    times = np.array(runs[pair.first].times)
    found = [(pair.first, times), (pair.second, times + pair.shift)]
    inside = times + pair.shift >= runs[pair.second].times[0]
    for k, at in found:
        begin, end = _driven(runs[k])
        inside &= (at >= begin) & (at <= min(end, runs[k].times[-1]))
    return [(k, at[inside]) for k, at in found]


def alike(first: Sequence[Array], second: Sequence[Array]) -> float:
    """Correlation of wrenches (n, 3) of some runs, mean over X, Y, N."""
    a, b = (np.concatenate([w - w.mean(axis=0) for w in wrenches]) for wrenches in (first, second))
    return float(np.mean((a * b).mean(axis=0) / np.maximum(a.std(axis=0) * b.std(axis=0), 1e-300)))
