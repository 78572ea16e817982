"""Whether what a model leaves is the disturbance that its likelihood claims.

Recordings are made by the model and the fitted levels. The real ones must not be the most extreme, in the
error or in the patterns that the filter sees: a push that is stronger in some places or at some times, one of
a fixed frequency, one that comes back with the same commands. Beside 99 artificial ones, real ones made alike
are the most extreme once in a hundred times; less often because the model is fitted to them.
"""

import contextlib
from dataclasses import dataclass
from typing import List, Optional, Sequence

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
    rates, pairs = patterns.frequencies(likelihood.runs, seconds), patterns.pairs(runs)

    def patterns_of(recorded: Sequence[_core.RunData]) -> patterns.Seen:
        poses = [by_poses_alone(run) for run in recorded]
        return patterns.seen(Likelihood(poses, likelihood.craft, likelihood.varying), fit, rates, pairs)

    def made(seed: int) -> Optional[List[float]]:
        """Logarithm of the squared error, and patterns; None where the motion is not finite."""
        random = np.random.default_rng(seed)
        try:
            artificial = [_recorded(run, fit, i, random, True) for i, run in enumerate(runs)]
            error = float(squared_errors(artificial, cut, fit.model, scale=runs).mean())
            return _numbers(error, patterns_of(artificial))
        except GroundError:
            return None

    noise = np.nan
    with contextlib.suppress(GroundError):
        quiet = [_recorded(run, fit, i, np.random.default_rng(0), False) for i, run in enumerate(runs)]
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
    frequency = None if holds else _frequency(numbers, rates, real)
    common = _common(numbers[1:, -1], real.common, len(pairs)) if pairs else None
    a, b, c = (float(np.sqrt(value)) for value in (error, average, noise))
    return Agreement(a, b, c, holds, frequency, common)


def _numbers(error: float, found: patterns.Seen) -> List[float]:
    """What is compared: the larger, the less like a random disturbance."""
    return [float(np.log(error)), *found.tails, *found.strongest, found.common]


def _frequency(rows: Array, rates: Array, real: patterns.Seen) -> Optional[float]:
    """The frequency that stands out, if it does more than all else."""
    lines = slice(-1 - real.lines.shape[1], -1)
    off = _deviations(rows)[0]
    if not len(rates) or off[lines].max() < off.max():
        return None
    frame = int(np.argmax(off[lines]))
    return float(rates[np.argmax(real.lines[:, frame])])


def _common(artificial: Array, share: float, pairs: int) -> Common:
    """What is in common, with the uncertainty that artificial recordings without anything in common have."""
    deviation = float(artificial.std()) if len(artificial) else np.inf
    return Common(pairs, share, share - DEVIATIONS * deviation, share + DEVIATIONS * deviation)


def share_as_extreme(values: Array) -> float:
    """Share of the rows (n, k) of which a number is as far above the mean of all, in standard deviations, as
    any of the first row: its p-value, if it is like the others, of whatever distribution."""
    most = _deviations(values).max(axis=1)
    return float((most >= most[0]).mean())


def _deviations(rows: Array) -> Array:
    """Rows (n, k) less their mean, in standard deviations."""
    return np.asarray((rows - rows.mean(axis=0)) / np.maximum(rows.std(axis=0), 1e-300))


def _recorded(run: _core.RunData, fit: Fit, i: int, random: Random, disturbed: bool) -> _core.RunData:
    """An artificial recording of a run, with or without the disturbance and its trim."""
    if not disturbed:
        return window_error.recorded(run, fit.model, random)
    factor, trim = np.exp(fit.loudness[i]) if fit.loudness else 1.0, fit.trims[i]
    wrench, room = window_error.pushes(run, fit.levels, random)
    wrench = factor * wrench + np.array(trim["wrench"])
    return window_error.recorded(run, fit.model, random, wrench, trim["thrust"], factor * room)
