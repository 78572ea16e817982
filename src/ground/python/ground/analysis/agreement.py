"""Whether what a model leaves is the disturbance that its likelihood claims.

Recordings are made by the model and the fitted levels, as often as it takes for a spread. The
errors of the real ones and the shape of the wrench that the filter sees must be among theirs: a
push that is stronger in some places or at some times gives a wrench with heavier tails.
"""

import contextlib
from dataclasses import dataclass
from typing import Dict, List, Optional, Sequence, Tuple

import numpy as np

from ground import _core
from ground.analysis import window_error
from ground.analysis.likelihood import Fit, Likelihood
from ground.analysis.thinning import by_poses_alone
from ground.analysis.window_error import squared_errors
from ground.support.annotations import Array, Each, Random
from ground.support.errors import GroundError

DRAWS = 15
FAR = 3.3  # standard deviations of the artificial recordings


@dataclass(frozen=True)
class Agreement:
    """Real recordings beside those that the model and its levels make."""

    error: float  # root mean square error of the real ones
    expected: float  # of the artificial ones
    noise: float  # of artificial ones with the poses' noise alone; NaN where the motion is not finite
    deviations: Dict[str, float]  # of the real ones from the artificial ones, in standard deviations

    @property
    def holds(self) -> bool:
        """Whether the real recordings are no worse than the artificial ones. A smaller error is allowed: the
        levels take coloured noise of the poses for a push."""
        return all(d < FAR for d in self.deviations.values())


def agreement(
    runs: Sequence[_core.RunData],
    cut: Sequence[_core.Window],
    likelihood: Likelihood,
    fit: Fit,
    each: Each = map,
) -> Agreement:
    """The Agreement of a Fit on runs over windows of them; each: maps over artificial recordings."""

    def made(seed: int) -> Optional[Tuple[float, List[float]]]:
        """Error, and tails of the wrench; None where the motion is not finite."""
        random = np.random.default_rng(seed)
        try:
            artificial = [_recorded(run, fit, i, random, True) for i, run in enumerate(runs)]
            error = float(squared_errors(artificial, cut, fit.model, scale=runs).mean())
            return error, _tails(artificial, likelihood, fit)
        except GroundError:
            return None

    drawn = [d for d in each(made, range(1, DRAWS + 1)) if d is not None]
    noise = np.nan
    with contextlib.suppress(GroundError):
        quiet = [_recorded(run, fit, i, np.random.default_rng(0), False) for i, run in enumerate(runs)]
        noise = float(squared_errors(quiet, cut, fit.model, scale=runs).mean())
    error = float(squared_errors(runs, cut, fit.model).mean())
    expected = np.array([d[0] for d in drawn])
    deviations = {"error": _deviation(np.log(error), np.log(expected))}
    shapes = np.array([d[1] for d in drawn])
    for channel, value, others in zip(
        "XYN", _tails(likelihood.runs, likelihood, fit), shapes.reshape(-1, 3).T
    ):
        deviations["tails of " + channel] = max(0.0, _deviation(value, others))
    average = expected.mean() if len(drawn) else error
    return Agreement(float(np.sqrt(error)), float(np.sqrt(average)), float(np.sqrt(noise)), deviations)


def _deviation(value: float, others: Array) -> float:
    if len(others) < 3:
        return FAR  # too few artificial motions are finite to say that the real ones are like them
    return float((value - others.mean()) / max(others.std(ddof=1), 1e-3))


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
