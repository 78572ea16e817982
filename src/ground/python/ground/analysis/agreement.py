"""Whether what a model leaves is the disturbance that its likelihood claims.

Recordings are made by the model and the fitted levels. The real ones must not be the most extreme, in the
error or in the shape of the wrench that the filter sees: a push that is stronger in some places or at some
times gives a wrench with heavier tails. Beside 99 artificial ones, real ones made alike are the most extreme
once in a hundred times; less often because the model is fitted to them.
"""

import contextlib
from dataclasses import dataclass
from typing import List, Optional, Sequence

import numpy as np

from ground import _core
from ground.analysis import window_error
from ground.analysis.likelihood import Fit, Likelihood
from ground.analysis.thinning import by_poses_alone
from ground.analysis.window_error import squared_errors
from ground.support.annotations import Array, Each, Random
from ground.support.errors import GroundError

FIRST, DRAWS = 19, 99  # artificial recordings; more than the first only where the real ones are extreme


@dataclass(frozen=True)
class Agreement:
    """Real recordings beside those that the model and its levels make."""

    error: float  # root mean square error of the real ones
    expected: float  # of the artificial ones
    noise: float  # of artificial ones with the poses' noise alone; NaN where the motion is not finite
    # whether the real ones are no worse; a smaller error is allowed: the levels take coloured noise of the
    # poses for a push
    holds: bool


def agreement(
    runs: Sequence[_core.RunData],
    cut: Sequence[_core.Window],
    likelihood: Likelihood,
    fit: Fit,
    each: Each = map,
) -> Agreement:
    """The Agreement of a Fit on runs over windows of them; each: maps over artificial recordings."""

    def made(seed: int) -> Optional[List[float]]:
        """Logarithm of the squared error, and tails of the wrench; None where the motion is not finite."""
        random = np.random.default_rng(seed)
        try:
            artificial = [_recorded(run, fit, i, random, True) for i, run in enumerate(runs)]
            error = float(squared_errors(artificial, cut, fit.model, scale=runs).mean())
            return [np.log(error), *_tails(artificial, likelihood, fit)]
        except GroundError:
            return None

    noise = np.nan
    with contextlib.suppress(GroundError):
        quiet = [_recorded(run, fit, i, np.random.default_rng(0), False) for i, run in enumerate(runs)]
        noise = float(squared_errors(quiet, cut, fit.model, scale=runs).mean())
    error = float(squared_errors(runs, cut, fit.model).mean())
    seen = [[np.log(error), *_tails(likelihood.runs, likelihood, fit)]]
    holds = False
    for seeds in (range(FIRST), range(FIRST, DRAWS)):
        seen += [d for d in each(made, seeds) if d is not None]
        # where few artificial motions are finite, the real ones are not like them
        holds = len(seen) > FIRST / 2 and share_as_extreme(np.array(seen)) > 1 / len(seen)
        if holds:
            break
    average = np.exp([one[0] for one in seen[1:]]).mean() if seen[1:] else error
    return Agreement(float(np.sqrt(error)), float(np.sqrt(average)), float(np.sqrt(noise)), holds)


def share_as_extreme(values: Array) -> float:
    """Share of the rows (n, k) of which a number is as far above the mean of all, in standard deviations, as
    any of the first row: its p-value, if it is like the others, of whatever distribution."""
    most = ((values - values.mean(axis=0)) / np.maximum(values.std(axis=0), 1e-300)).max(axis=1)
    return float((most >= most[0]).mean())


def _recorded(run: _core.RunData, fit: Fit, i: int, random: Random, disturbed: bool) -> _core.RunData:
    """An artificial recording of a run, with or without the disturbance and its trim."""
    if not disturbed:
        return window_error.recorded(run, fit.model, random)
    factor, trim = np.exp(fit.loudness[i]) if fit.loudness else 1.0, fit.trims[i]
    wrench, room = window_error.pushes(run, fit.levels, random)
    wrench = factor * wrench + np.array(trim["wrench"])
    return window_error.recorded(run, fit.model, random, wrench, trim["thrust"], factor * room)


def _tails(runs: Sequence[_core.RunData], like: Likelihood, fit: Fit) -> List[float]:
    """Logarithm of the kurtosis of the wrench X, Y, N that the filter sees in poses, over each run's own
    level."""
    seen, by_poses = [], Likelihood([by_poses_alone(run) for run in runs], like.craft, like.varying)
    for i in range(len(runs)):
        wrench = np.array(by_poses.residuals(fit.point, i)["wrench"])
        seen.append(wrench / np.maximum(np.sqrt((wrench**2).mean(axis=0)), 1e-30))
    every = np.concatenate(seen)
    return list(np.log((every**4).mean(axis=0)))
