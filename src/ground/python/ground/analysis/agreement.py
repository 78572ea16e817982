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
from ground.analysis.distributions import DEVIATIONS
from ground.analysis.likelihood import Fit, Likelihood
from ground.analysis.thinning import by_poses_alone
from ground.analysis.window_error import squared_errors
from ground.support.annotations import Array, Each, Random
from ground.support.errors import GroundError

FIRST, DRAWS = 19, 99  # artificial recordings; more than the first only where the real ones are extreme


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

    def compared(recorded: Sequence[_core.RunData]) -> Tuple[float, patterns.Seen]:
        """The squared error of recordings, and what the filter sees in them."""
        error = float(squared_errors(recorded, cut, fit.model, scale=runs).mean())
        poses = [by_poses_alone(run) for run in recorded]
        of_poses = Likelihood(poses, likelihood.craft, likelihood.varying)
        return error, patterns.seen(of_poses, fit, band, pairs)

    def made(seed: int) -> Optional[Tuple[List[float], float]]:
        """Numbers of an artificial recording, and the squared correlation of what the filter sees in it and
        what pushed; None where the motion is not finite."""
        random = np.random.default_rng(seed)
        try:
            artificial, pushes = zip(*(_pushed(run, fit, i, random) for i, run in enumerate(runs)))
            error, found = compared(artificial)
        except GroundError:
            return None
        width = seconds / patterns.FINEST
        known = [_at(*given, width) for given in zip(runs, pushes, likelihood.runs)]
        return [float(np.log(error)), *found.numbers], patterns.alike(found.wrenches, known) ** 2

    noise = np.nan
    with contextlib.suppress(GroundError):
        quiet = [window_error.recorded(run, fit.model, np.random.default_rng(0)) for run in runs]
        noise = float(squared_errors(quiet, cut, fit.model, scale=runs).mean())
    error, real = compared(runs)
    rows, seen_of_push = [[float(np.log(error)), *real.numbers]], []
    holds = False
    for seeds in (range(FIRST), range(FIRST, DRAWS)):
        drawn = [one for one in each(made, seeds) if one is not None]
        rows += [numbers for numbers, _ in drawn]
        seen_of_push += [share for _, share in drawn]
        # where few artificial motions are finite, the real ones are not like them
        holds = len(rows) > FIRST / 2 and share_as_extreme(np.array(rows)) > 1 / len(rows)
        if holds:
            break
    numbers = np.array(rows)
    average = np.exp(numbers[1:, 0]).mean() if rows[1:] else error
    off = _deviations(numbers)[0]
    frequency, common, lines = None, None, off[4:6]  # behind the error and the tails
    if not holds and lines.max() == off.max():
        frequency = float(band.rates[np.argmax(real.lines[:, int(np.argmax(lines))])])
    if pairs:
        # without anything in common, artificial ones differ as much; the filter sees a part of a push only
        seen = max(float(np.mean(seen_of_push)), 1e-3) if seen_of_push else 1e-3
        half = DEVIATIONS * float(numbers[1:, -1].std()) if rows[1:] else np.inf
        low, high = ((real.common + side * half) / seen for side in (-1, 1))
        stands_out = not holds and bool(off[-1] == off.max())
        common = Common(len(pairs), real.common / seen, low, high, stands_out)
    measured, expected, floor = (float(np.sqrt(value)) for value in (error, average, noise))
    return Agreement(measured, expected, floor, holds, frequency, common)


def share_as_extreme(values: Array) -> float:
    """Share of the rows (n, k) of which a number is as far above the mean of all, in standard deviations, as
    any of the first row: its p-value, if it is like the others, of whatever distribution."""
    most = _deviations(values).max(axis=1)
    return float((most >= most[0]).mean())


def _deviations(rows: Array) -> Array:
    """Rows (n, k) less their mean, in standard deviations."""
    return np.asarray((rows - rows.mean(axis=0)) / np.maximum(rows.std(axis=0), 1e-300))


def _pushed(run: _core.RunData, fit: Fit, i: int, random: Random) -> Tuple[_core.RunData, Array]:
    """An artificial recording of a run, with its trim and the disturbance; and the disturbance X, Y [N],
    N [N m], body, at its samples."""
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
