"""Whether what a model leaves is the disturbance that its likelihood claims.

Recordings are made by the model and the fitted levels. The real ones must not be the most extreme, in the
error or in the patterns that the filter sees: a push that is stronger in some places or at some times, one of
a fixed frequency, one that comes back with the same commands. Beside 99 artificial ones, real ones made alike
are the most extreme once in a hundred times; less often because the model is fitted to them.
"""

import contextlib
from dataclasses import dataclass
from typing import List, Optional, Sequence, Tuple

import numpy as np

from ground import _core
from ground.analysis import patterns, window_error
from ground.analysis.likelihood import Fit, Likelihood
from ground.analysis.thinning import by_poses_alone
from ground.analysis.window_error import squared_errors
from ground.support.annotations import Array, Each, Random
from ground.support.errors import GroundError

FIRST, DRAWS = 19, 99  # artificial recordings; more than the first only where the real ones are extreme
DEVIATIONS = 1.96  # of an interval


@dataclass(frozen=True)
class Common:
    """What pairs of runs with the same commands have in common of the wrench that the filter sees."""

    pairs: int
    share: float
    low: float  # 95% interval
    high: float
    stands_out: bool  # whether it is why the recordings do not agree


@dataclass(frozen=True)
class Agreement:
    """Real recordings beside those that the model and its levels make."""

    error: float  # root mean square error of the real ones
    expected: float  # of the artificial ones
    noise: float  # of artificial ones with the poses' noise alone; NaN where the motion is not finite
    # whether the real ones are no worse; a smaller error is allowed: the levels take coloured noise of the
    # poses for a push
    holds: bool
    frequency: Optional[float]  # [Hz] that stands out most, where it is why they do not agree
    common: Optional[Common]  # None where no commands were given twice


def agreement(
    runs: Sequence[_core.RunData],
    cut: Sequence[_core.Window],
    likelihood: Likelihood,
    fit: Fit,
    seconds: float,
    each: Each = map,
) -> Agreement:
    """The Agreement of a Fit on runs over windows of them. seconds: horizon of predictions; each: maps over
    artificial recordings."""
    band, pairs = patterns.band(likelihood.runs, seconds), patterns.pairs(runs)
    seen_of_push: List[float] = []  # correlation of what the filter sees and what pushed, squared

    def patterns_of(recorded: Sequence[_core.RunData]) -> patterns.Seen:
        poses = [by_poses_alone(run) for run in recorded]
        return patterns.seen(Likelihood(poses, likelihood.craft, likelihood.varying), fit, band, pairs)

    def made(seed: int) -> Optional[List[float]]:
        """Logarithm of the squared error, and patterns; None where the motion is not finite."""
        random = np.random.default_rng(seed)
        try:
            pushed = [_recorded(run, fit, i, random, True) for i, run in enumerate(runs)]
            artificial = [run for run, _ in pushed]
            error = float(squared_errors(artificial, cut, fit.model, scale=runs).mean())
            found = patterns_of(artificial)
            if pairs:
                width = seconds / patterns.FINEST
                known = [_at(run, push, like, width) for (run, push), like in zip(pushed, likelihood.runs)]
                seen_of_push.append(patterns.alike(found.wrenches, known) ** 2)
            return _numbers(error, found)
        except GroundError:
            return None

    noise = np.nan
    with contextlib.suppress(GroundError):
        quiet = [_recorded(run, fit, i, np.random.default_rng(0), False)[0] for i, run in enumerate(runs)]
        noise = float(squared_errors(quiet, cut, fit.model, scale=runs).mean())
    error = float(squared_errors(runs, cut, fit.model).mean())
    real = patterns_of(runs)
    rows = [_numbers(error, real)]
    holds = False
    for seeds in (range(FIRST), range(FIRST, DRAWS)):
        rows += [d for d in each(made, seeds) if d is not None]
        # where few artificial motions are finite, the real ones are not like them
        holds = len(rows) > FIRST / 2 and share_as_extreme(np.array(rows)) > 1 / len(rows)
        if holds:
            break
    average = np.exp([one[0] for one in rows[1:]]).mean() if rows[1:] else error
    numbers = np.array(rows)
    off = _deviations(numbers)[0]
    frequency = None if holds else _frequency(off, band, real)
    common = None
    if pairs:
        stands_out = not holds and bool(off[-1] == off.max())
        common = _common(numbers[1:, -1], real.common, seen_of_push, len(pairs), stands_out)
    a, b, c = (float(np.sqrt(value)) for value in (error, average, noise))
    return Agreement(a, b, c, holds, frequency, common)


def _numbers(error: float, found: patterns.Seen) -> List[float]:
    """What is compared: the larger, the less like a random disturbance."""
    return [float(np.log(error)), *found.tails, *found.strongest, found.common]


def _frequency(off: Array, band: patterns.Band, real: patterns.Seen) -> Optional[float]:
    """The frequency that stands out, if it does more than all else; off: deviations of the numbers."""
    lines = off[-1 - real.lines.shape[1] : -1]
    if lines.max() < off.max():
        return None
    return float(band.rates[np.argmax(real.lines[:, int(np.argmax(lines))])])


def _common(
    artificial: Array, share: float, seen_of_push: Sequence[float], pairs: int, stands_out: bool
) -> Common:
    """What is in common, with the uncertainty that artificial recordings without anything in common have; the
    filter sees a part of it only, as of pushes that are known."""
    seen = max(float(np.mean(sorted(seen_of_push))), 1e-3) if seen_of_push else 1e-3
    deviation = float(artificial.std()) if len(artificial) else np.inf
    low, high = (share + side * DEVIATIONS * deviation for side in (-1, 1))
    return Common(pairs, share / seen, low / seen, high / seen, stands_out)


def share_as_extreme(values: Array) -> float:
    """Share of the rows (n, k) of which a number is as far above the mean of all, in standard deviations, as
    any of the first row: its p-value, if it is like the others, of whatever distribution."""
    most = _deviations(values).max(axis=1)
    return float((most >= most[0]).mean())


def _deviations(rows: Array) -> Array:
    """Rows (n, k) less their mean, in standard deviations."""
    return np.asarray((rows - rows.mean(axis=0)) / np.maximum(rows.std(axis=0), 1e-300))


def _recorded(
    run: _core.RunData, fit: Fit, i: int, random: Random, disturbed: bool
) -> Tuple[_core.RunData, Array]:
    """An artificial recording of a run, with or without the disturbance and its trim; and the disturbance
    X, Y [N], N [N m], body, at its samples."""
    if not disturbed:
        return window_error.recorded(run, fit.model, random), np.zeros((len(run.times), 3))
    factor, trim = np.exp(fit.loudness[i]) if fit.loudness else 1.0, fit.trims[i]
    wrench, room = window_error.pushes(run, fit.levels, random)
    acting = factor * wrench + np.array(trim["wrench"])
    made = window_error.recorded(run, fit.model, random, acting, trim["thrust"], factor * room)
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
