"""Whether runs agree on the parameters of a fit.

A likelihood weighs runs by what noise and disturbance explain. Where their own values differ by more, the
interval of the common value is too narrow. The own value of a run is a few Newton steps from the common
one. That all are the same is tested by the weighted squares of first steps (Cochran 1954), which derivatives
at the common value alone give. Whatever it says, the interval contains the interval of the mean of values
that differ from run to run (Paule and Mandel 1982), of the runs that tell a parameter."""

from dataclasses import replace
from typing import Dict, List, Sequence, Tuple

import numpy as np
from scipy.optimize import brentq

from ground.analysis.distributions import LEVEL, chi_squared_above, student_limit
from ground.analysis.likelihood import Likelihood, LikelihoodFit
from ground.analysis.score_tests import moved, solve, stepped
from ground.effect_library.parameters import FittedParameter, ParameterInfo, described
from ground.support.annotations import Array
from ground.support.errors import Diverged

# Information that keeps directions that a run does not identify at the common value, over all runs'
WEAK = 1e-6
TOLD = 0.01  # largest variance of a parameter that a run tells, over that by the weak information alone


def widened(
    likelihood: Likelihood, fit: LikelihoodFit, parameters: Sequence[FittedParameter]
) -> List[FittedParameter]:
    """Parameters as LikelihoodFit.parameters has them, with intervals that contain what its runs differ by.
    Those in which they differ have `runs`, the least and the largest of the runs' own values. Standard
    deviations grow as the intervals do."""
    if len(likelihood.runs) < 2:
        return list(parameters)
    alone = [Likelihood([run], likelihood.craft, threads=likelihood.threads) for run in likelihood.runs]
    fits = [replace(fit, loudness=fit.loudness[i : i + 1]) for i in range(len(alone))]
    try:
        scores = [on.scores(one, one.model, one.free) for on, one in zip(alone, fits)]
    except Diverged:  # the motion of a run is not finite there
        return list(parameters)
    weak = WEAK * np.diag(np.maximum(sum(np.diag(of_run["information"]) for of_run in scores), 1e-300))
    own = [_newton(*of_run, weak) for of_run in zip(alone, fits, scores)]
    known, found = described(fit.model), []
    for p in parameters:
        if p["identified"] and p["name"] in fit.free:
            j = fit.free.index(p["name"])
            first, last = (_told([steps[at] for steps in own], j) for at in (0, -1))
            differ = len(fit.free) * chance(*first) < LEVEL
            p = _widened(p, known[p["name"]], *last, differ)
        found.append(p)
    return found


def _told(own: Sequence[Tuple[Array, Array]], j: int) -> Tuple[Array, Array]:
    """Steps and variances of a parameter, of the runs that determine it. own: of each run, of all."""
    steps, variances = np.array([(steps[j], variances[j]) for steps, variances in own]).T
    good = np.isfinite(steps) & np.isfinite(variances) & (variances > 0)
    return steps[good], variances[good]


def _newton(
    alone: Likelihood, fit: LikelihoodFit, scores: Dict[str, Array], weak: Array
) -> List[Tuple[Array, Array]]:
    """Coordinates of a run's own values relative to the coordinates of a fit, and their variances, infinite
    where the run does not identify a parameter, after each of four Newton steps. alone: of the run; scores:
    at the common values; weak: information added to the run's own."""
    scale, at, found = scores["scale"], np.zeros(len(weak)), []
    while True:
        covariance = solve(scores["information"] + weak, np.eye(len(weak)))
        at = at + covariance @ (scores["score"].sum(axis=0) - weak @ at)
        variances = np.maximum(np.diag(covariance), 0)
        is_told = variances * np.diag(weak) < TOLD
        found.append((scale * at, np.where(is_told, scale**2 * variances, np.inf)))
        if len(found) == 4 or not np.isfinite(at).all():
            return found
        model = stepped(fit.model, dict(zip(fit.free, (scale * at).tolist())))
        try:
            scores = alone.scores(fit, model, fit.free)
        except Diverged:  # the motion is not finite there
            return found


def chance(steps: Array, variances: Array) -> float:
    """Probability that values of runs (n,) with variances of their own (n,) differ as much although they are
    the same."""
    return chi_squared_above(_squares(steps, variances, 0.0), len(steps) - 1) if len(steps) > 1 else 1.0


def mean_of(steps: Array, variances: Array) -> Tuple[float, float, float]:
    """The mean of values of runs (n,) with variances of their own (n,), half its 95% interval, and the
    variance between runs, 0 where they differ by no more than their own; else Student's t has the degrees of
    freedom of as many runs as weigh the same together."""
    between = _between(steps, variances)
    weights = 1 / (variances + between)
    freedom = max(1.0, weights.sum() ** 2 / (weights @ weights) - 1) if between else np.inf
    half = student_limit(0.025, freedom) / np.sqrt(weights.sum())
    return float(weights @ steps / weights.sum()), float(half), between


def _widened(
    p: FittedParameter, known: ParameterInfo, steps: Array, variances: Array, differ: bool
) -> FittedParameter:
    """A parameter. steps, variances: of its coordinate, of each run from which it is identifiable; differ:
    whether the runs are reported to differ."""
    if len(steps) < 2:
        return p
    mean, half, between = mean_of(steps, variances)
    ends = [moved(known, p["value"], by) for by in (mean - half, mean + half)]
    wide, (low, high) = p.copy(), p["ci95"]
    wide["ci95"] = min(low, *ends), max(high, *ends)
    if 0 < high - low < np.inf:
        wide["deviation"] = p["deviation"] * (wide["ci95"][1] - wide["ci95"][0]) / (high - low)
    certain = steps[variances < 2 * (between + variances.min())]
    own = [moved(known, p["value"], by) for by in (certain.min(), certain.max())]
    if differ and own[0] != own[1]:  # equal: they only differ by how far beyond its range they are
        wide["runs"] = min(own), max(own)
    return wide


def _squares(steps: Array, variances: Array, between: float) -> float:
    """Weighted squares about the weighted mean of values with variances of their own and one between runs."""
    weights = 1 / (variances + between)
    return float(weights @ (steps - weights @ steps / weights.sum()) ** 2)


def _between(steps: Array, variances: Array) -> float:
    """The variance between runs with which the squares are as many as expected; 0 where none is needed."""
    if _squares(steps, variances, 0.0) <= len(steps) - 1:
        return 0.0
    largest = float(np.var(steps, ddof=1))  # as many or fewer: the mean of all has more squares
    return largest * float(brentq(lambda v: _squares(steps, variances, v * largest) - len(steps) + 1, 0, 1))
