"""Whether runs agree on the parameters of a fit.

A likelihood weighs runs by what noise and disturbance explain. Where their own values differ by more, the
interval of the common value is too narrow. The own value of a run is a few Newton steps from the common
one. That all are the same is tested by the weighted squares of first steps (Cochran 1954), which derivatives
at the common value alone give; where they are not, the interval is that of the mean of values that differ
from run to run, too (Paule and Mandel 1982).
"""

from dataclasses import replace
from typing import Dict, List, NamedTuple, Sequence, Tuple

import numpy as np

from ground.analysis.distributions import chi_squared_above, student_limit
from ground.analysis.likelihood import Fit, Likelihood
from ground.analysis.score_tests import moved, solve, stepped
from ground.support.annotations import Array, Document
from ground.support.errors import GroundError

LEVEL = 0.01  # probability that any parameter is said to differ although none does
OUTSIDE = 0.025  # probability on each side of an interval
STEPS = 4  # of Newton
WEAK = 1e-6  # information that keeps what a run does not tell at the common value, over that of all runs


class _Own(NamedTuple):
    """What each run alone says about parameters: steps of coordinates from the common values, and their
    standard deviations, both (runs, parameters)."""

    steps: Array
    deviations: Array

    @classmethod
    def of(
        cls, likelihood: Likelihood, fit: Fit, scores: Sequence[Dict[str, Array]], weak: Array, most: int
    ) -> "_Own":
        """After at most some Newton steps from a Fit. scores: of each run there; weak: information that is
        added to that of a run."""
        found = [_own_of(likelihood, fit, run, own, weak, most) for run, own in enumerate(scores)]
        return cls(*(np.array(values) for values in zip(*found)))

    def known(self, j: int) -> Tuple[Array, Array]:
        """Steps and variances of a parameter, of the runs that determine it."""
        steps, variances = self.steps[:, j], self.deviations[:, j] ** 2
        good = np.isfinite(steps) & np.isfinite(variances) & (variances > 0)
        return steps[good], variances[good]

    def chance(self, j: int) -> float:
        """Probability that the values of a parameter differ as much although they are the same."""
        steps, variances = self.known(j)
        return chi_squared_above(_squares(steps, variances, 0.0), len(steps) - 1) if len(steps) > 1 else 1.0


def widened(likelihood: Likelihood, fit: Fit, parameters: Sequence[Document]) -> List[Document]:
    """Parameters of a Fit as Fit.parameters has them, with intervals that contain what its runs differ by.
    Those in which they differ have `runs`, the least and the largest of the runs' own values."""
    if len(likelihood.runs) < 2:
        return list(parameters)
    try:
        scores = [likelihood.scores_of(fit, run) for run in range(len(likelihood.runs))]
    except GroundError:  # the motion of a run is not finite there
        return list(parameters)
    weak = WEAK * np.diag(np.maximum(sum(np.diag(of_run["information"]) for of_run in scores), 1e-300))
    first = _Own.of(likelihood, fit, scores, weak, 1)
    differ = [j for j, name in enumerate(fit.free) if len(fit.free) * first.chance(j) < LEVEL]
    if not differ:
        return list(parameters)
    own = _Own.of(likelihood, fit, scores, weak, STEPS)
    described = {p["name"]: p for p in fit.model.parameters()}
    names = {fit.free[j]: j for j in differ}
    return [
        _widened(p, described[p["name"]], *own.known(names[p["name"]]))
        if p["identified"] and p["name"] in names
        else p
        for p in parameters
    ]


def _own_of(
    likelihood: Likelihood, fit: Fit, run: int, scores: Dict[str, Array], weak: Array, most: int
) -> Tuple[Array, Array]:
    """Steps of coordinates and their deviations of a run, after at most some Newton steps. scores: at the
    common values."""
    scale, at = scores["scale"], np.zeros(len(weak))
    for step in range(most):
        covariance = solve(scores["information"] + weak, np.eye(len(weak)))
        at = at + covariance @ (scores["score"].sum(axis=0) - weak @ at)
        if step == most - 1 or not np.isfinite(at).all():
            break
        model = stepped(fit.model, dict(zip(fit.free, (scale * at).tolist())))
        try:
            scores = likelihood.scores_of(replace(fit, model=model), run)
        except GroundError:  # the motion is not finite there
            break
    return scale * at, scale * np.sqrt(np.maximum(np.diag(covariance), 0))


def _widened(p: Document, described: Document, steps: Array, variances: Array) -> Document:
    """A parameter that differs. steps, variances: of its coordinate, of each run."""
    between = _between(steps, variances)
    weights = 1 / (variances + between)
    mean = weights @ steps / weights.sum()
    half = student_limit(OUTSIDE, len(steps) - 1) / np.sqrt(weights.sum())
    ends = [moved(described, p["value"], by) for by in (mean - half, mean + half)]
    low, high = (float(end) for end in p["ci95"])
    certain = steps[variances < 2 * (between + variances.min())]
    own = [moved(described, p["value"], by) for by in (certain.min(), certain.max())]
    if own[0] == own[1]:  # they only differ by how far beyond its range they are
        return p
    return {**p, "ci95": (min(low, *ends), max(high, *ends)), "runs": (min(own), max(own))}


def _squares(steps: Array, variances: Array, between: float) -> float:
    """Weighted squares about the weighted mean of values with variances of their own and one between runs."""
    weights = 1 / (variances + between)
    return float(weights @ (steps - weights @ steps / weights.sum()) ** 2)


def _between(steps: Array, variances: Array) -> float:
    """The variance between runs with which the squares are as many as expected; by bisection."""
    low, high = 0.0, float(np.var(steps) * len(steps) + 1e-300)
    while _squares(steps, variances, high) > len(steps) - 1:
        low, high = high, 2 * high
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _squares(steps, variances, middle) > len(steps) - 1 else (low, middle)
    return high
