"""Whether what a model leaves is the disturbance that its likelihood claims.

Recordings are made by the model and the fitted levels. The real ones must not be the most extreme, in the
error or in the patterns that the filter sees: a push that is stronger in some places or at some times, one of
a fixed frequency (innovations are white if the model and its disturbance are true, Kailath 1968), one that
comes back with the same commands. Beside 99 artificial ones, real ones made alike are the most extreme once
in a hundred times; less often because the model is fitted to them.
"""

import contextlib
import itertools
import math
from dataclasses import dataclass, field
from typing import List, Optional, Sequence, Tuple

import numpy as np

from ground import _core
from ground.analysis import residuals, window_error
from ground.analysis.distributions import DEVIATIONS
from ground.analysis.likelihood import Likelihood, LikelihoodFit
from ground.analysis.thinning import by_poses_alone
from ground.analysis.window_error import squared_errors
from ground.poses import scatter
from ground.support.annotations import Array, Each, Flags, Random
from ground.support.errors import Diverged
from ground.support.records import NULL

ALIKE = 0.9  # least correlation of commands that count as the same: edges are some milliseconds apart
FINEST = 10.0  # periods of the highest frequency in a horizon: faster pushes hardly move a craft in it
MOST_PAIRS = 20
MIN_SHARE = 0.05  # least share of the squared error by which the data determine a random disturbance
FIRST, DRAWS = 19, 99  # artificial recordings; more than the first only where the real ones are extreme


@dataclass(frozen=True)
class Common:
    """What pairs of runs with the same commands have in common of the wrench that the filter sees."""

    pairs: int
    share: float
    low: float = field(metadata={NULL: -math.inf})  # 95% interval
    high: float = field(metadata={NULL: math.inf})
    stands_out: bool  # whether it is why the recordings do not agree


@dataclass(frozen=True)
class WindowErrors:
    """Root mean square errors of recordings."""

    measured: float  # of the real recordings
    expected: float  # of the artificial recordings
    noise: float  # of artificial recordings with only pose noise; NaN where the motion is not finite


@dataclass(frozen=True)
class Agreement:
    """Real recordings beside those that the model and its levels make."""

    error: WindowErrors
    # whether the real ones are no worse; a smaller error is allowed: the levels take coloured noise of the
    # poses for a push
    holds: bool
    frequency: Optional[float]  # [Hz] that stands out most, where it is why they do not agree
    common: Optional[Common]  # None where no commands were given twice

    @property
    def is_pushed(self) -> bool:
        """Whether the data, not their priors, determine the levels of the random disturbance."""
        error = self.error
        return not error.expected**2 - error.noise**2 < MIN_SHARE * error.measured**2


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
        """Power (k, n) at the frequencies of rows (m, n) at some times, relative to white residuals."""
        at = np.round((times - times[0]) / self.step).astype(int)
        grid = np.zeros((self.count, rows.shape[1]))
        np.add.at(grid, at, rows)
        return np.asarray(np.abs(np.fft.rfft(grid, axis=0)[self.inside]) ** 2 / max(1, len(times)))


# Two runs in which the same commands were given, and the time of the second run minus the time of the first,
# of the same command [s]
Pair = Tuple[int, int, float]


def agreement(
    runs: Sequence[_core.RunData],
    cut: Sequence[_core.Window],
    likelihood: Likelihood,
    fit: LikelihoodFit,
    seconds: float,
    each: Each = map,
) -> Agreement:
    """The Agreement of a LikelihoodFit on runs over windows of them. seconds: horizon of predictions; each:
    maps over artificial recordings."""
    band, pairs = _band(likelihood.runs, seconds), _pairs(runs)

    def compared(recorded: Sequence[_core.RunData]) -> Tuple[List[float], List[Array], Array, Likelihood]:
        """Numbers of recordings, the logarithm of the squared error first, what _seen gives, and of which
        runs."""
        error = squared_errors(recorded, cut, fit.model, scale=runs).mean()
        poses = [by_poses_alone(run) for run in recorded]
        of_poses = Likelihood(poses, likelihood.craft, likelihood.varying)
        numbers, wrenches, lines = _seen(of_poses, fit, band, pairs)
        return [float(np.log(error)), *numbers], wrenches, lines, of_poses

    def made(seed: int) -> Optional[Tuple[List[float], float]]:
        """Numbers of an artificial recording, and the squared correlation of what the filter sees in it and
        what pushed; None where the motion is not finite."""
        random = np.random.default_rng(seed)
        try:
            artificial, pushes = zip(*(_pushed(run, fit, i, random) for i, run in enumerate(runs)))
            numbers, wrenches, _, of_poses = compared(artificial)
        except Diverged:
            return None
        known = [_at(*given, seconds / FINEST) for given in zip(runs, pushes, of_poses.runs)]
        return numbers, _alike(wrenches, known) ** 2

    noise = np.nan
    with contextlib.suppress(Diverged):
        quiet = [window_error.recorded(run, fit.model, np.random.default_rng(0)) for run in runs]
        noise = float(squared_errors(quiet, cut, fit.model, scale=runs).mean())
    real, _, power, _ = compared(runs)
    rows, seen_of_push, holds = [real], [], False
    for seeds in (range(FIRST), range(FIRST, DRAWS)):
        drawn = [one for one in each(made, seeds) if one is not None]
        rows += [numbers for numbers, _ in drawn]
        seen_of_push += [share for _, share in drawn]
        # where few artificial motions are finite, the real ones are not like them
        holds = len(rows) > FIRST / 2 and share_as_extreme(np.array(rows)) > 1 / len(rows)
        if holds:
            break
    numbers = np.array(rows)
    average = np.exp(numbers[1:, 0] if rows[1:] else numbers[:, 0]).mean()
    off = _deviations(numbers)[0]
    frequency, common, lines = None, None, off[4:6]  # behind the error and the tails
    if not holds and lines.max() == off.max():
        frequency = float(band.rates[np.argmax(power[:, int(np.argmax(lines))])])
    if pairs:
        # without anything in common, artificial ones differ as much; the filter sees a part of a push only
        seen = max(float(np.mean(seen_of_push)), 1e-3) if seen_of_push else 1e-3
        half = DEVIATIONS * float(numbers[1:, -1].std()) if rows[1:] else np.inf
        low, high = ((real[-1] + side * half) / seen for side in (-1, 1))
        stands_out = not holds and bool(off[-1] == off.max())
        common = Common(len(pairs), real[-1] / seen, low, high, stands_out)
    errors = WindowErrors(*(float(np.sqrt(value)) for value in (np.exp(real[0]), average, noise)))
    return Agreement(errors, holds, frequency, common)


def share_as_extreme(values: Array) -> float:
    """Share of the rows (n, k) of which a number is as far above the mean of all, in standard deviations, as
    any of the first row: its p-value, if it is like the others, of whatever distribution."""
    most = _deviations(values).max(axis=1)
    return float((most >= most[0]).mean())


def _deviations(rows: Array) -> Array:
    """Rows (n, k) less their mean, in standard deviations."""
    return np.asarray((rows - rows.mean(axis=0)) / np.maximum(rows.std(axis=0), 1e-300))


def _pushed(run: _core.RunData, fit: LikelihoodFit, i: int, random: Random) -> Tuple[_core.RunData, Array]:
    """An artificial recording of a run, with its trim and the disturbance; and the disturbance X, Y [N],
    N [N m], body, at its samples."""
    factor, trim = np.exp(fit.loudness[i]) if fit.loudness else 1.0, fit.trims[i]
    wrench, room = window_error.pushes(run, fit.levels, random)
    acting = factor * wrench + trim[:3]
    made = window_error.recorded(run, fit.model, random, acting, float(trim[3]), factor * room)
    psi = np.array(made.eta)[:, 2]
    (x, y), c, s = np.array(room).T, np.cos(psi), np.sin(psi)
    turned = np.column_stack([c * x + s * y, c * y - s * x, np.zeros(len(psi))])
    return made, np.asarray(factor * (wrench + turned))


def _at(run: _core.RunData, push: Array, thinned: _core.RunData, width: float) -> Array:
    """Means over a width [s] of a push at the samples of a run (n, 3), at the samples of the thinned run."""
    times, at = np.array(run.times), np.array(thinned.times)
    sums = np.vstack([np.zeros(3), np.cumsum(push[:-1] * np.diff(times)[:, None], axis=0)])
    ends = [np.column_stack([np.interp(at + side * width / 2, times, c) for c in sums.T]) for side in (-1, 1)]
    return np.asarray(ends[1] - ends[0])


def _seen(
    likelihood: Likelihood, fit: LikelihoodFit, band: Band, pairs: Sequence[Pair]
) -> Tuple[List[float], List[Array], Array]:
    """What the filter of a LikelihoodFit sees in the runs of a Likelihood, without inertial samples: numbers,
    the larger, the less like a random disturbance; the wrench X, Y, N (n, 3) of each run, relative to its
    rms; and the power of the innovations in a Band, relative to its median, body and room (k, 2).

    The numbers are the logarithms of the kurtosis of the wrench, as a push at some times or places only has
    heavy tails, and of the strongest lines; and the correlation of the wrench in pairs, 0 without any."""
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
        common.append(_alike(both[:1], both[1:]))
    lines = lines / np.maximum(np.median(lines, axis=0), 1e-300)
    tails = (np.concatenate(wrenches) ** 4).mean(axis=0)
    numbers = [*np.log(tails), *np.log(lines.max(axis=0)), float(np.mean(common)) if common else 0.0]
    return numbers, wrenches, lines


def _band(runs: Sequence[_core.RunData], seconds: float) -> Band:
    """The Band of runs; seconds: horizon of predictions."""
    durations = [run.times[-1] - run.times[0] for run in runs]
    steps = [scatter.interval(np.array(run.times)) for run in runs]
    # twice as fine as the longest run
    count = 2 ** int(np.ceil(np.log2(2 * max(durations) / min(steps) + 2)))
    rates = np.fft.rfftfreq(count, min(steps))
    # two periods of the lowest one in a run of usual length
    lowest = 2 / max(float(np.median(durations)), 1e-9)
    highest = max(min(FINEST / seconds, 0.4 / max(steps)), 2 * lowest)
    inside = (rates >= lowest) & (rates <= highest)
    inside[-1] |= not inside.any()  # of a run that is too short for a line
    return Band(min(steps), count, inside)


def _pairs(runs: Sequence[_core.RunData]) -> List[Pair]:
    """The Pairs of runs that were given the same commands, from their first change on; MOST_PAIRS of many."""
    begins, found = [_driven(run)[0] for run in runs], []
    for i, j in itertools.combinations(range(len(runs)), 2):
        pair = (i, j, begins[j] - begins[i])
        given = [residuals.held(runs[k], at) for k, at in _together(runs, pair)]
        a, b = ((one - one.sum(axis=0) / max(1, len(one))).ravel() for one in given)
        if float(a @ b) > ALIKE * max(float(a @ a), float(b @ b), 1e-300):
            found.append(pair)
    return found[:: 1 + max(0, len(found) - 1) // MOST_PAIRS]


def _driven(run: _core.RunData) -> Tuple[float, float]:
    """Times of the first change of a command, and of the end of thrust [s]."""
    inputs = np.array(run.inputs)
    changes = np.flatnonzero((inputs[1:, 1:-1] != inputs[:-1, 1:-1]).any(axis=1)) + 1
    if not len(changes):
        return max(run.times[0], float(inputs[0, 0])), run.times[-1]
    ends = run.times[-1] if inputs[-1, 1:-1].any() else inputs[changes[-1], 0]
    return float(inputs[changes[0], 0]), float(ends)


def _together(runs: Sequence[_core.RunData], pair: Pair) -> List[Tuple[int, Array]]:
    """Both runs of a pair, and times of each in which both are driven; a wall may have ended one earlier."""
    first, second, shift = pair
    times = np.array(runs[first].times)
    found = [(first, times), (second, times + shift)]
    inside = times + shift >= runs[second].times[0]
    for k, at in found:
        begin, end = _driven(runs[k])
        inside &= (at >= begin) & (at <= min(end, runs[k].times[-1]))
    return [(k, at[inside]) for k, at in found]


def _alike(first: Sequence[Array], second: Sequence[Array]) -> float:
    """Correlation of wrenches (n, 3) of some runs, mean over X, Y, N."""
    a, b = (np.concatenate([w - w.mean(axis=0) for w in wrenches]) for wrenches in (first, second))
    return float(np.mean((a * b).mean(axis=0) / np.maximum(a.std(axis=0) * b.std(axis=0), 1e-300)))
