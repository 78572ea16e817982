"""The ceiling of a model: how much of its error any function of what was recorded could still explain.

A regression of the innovations (ground.analysis.regression) finds what they depend on. Its wrench for each
run, estimated from the others, is handed to the filter as a known input; levels and parameters are fitted
again, and the regression repeated (docs/theory/ceiling.md).
"""

import functools
from dataclasses import dataclass, replace
from typing import Callable, Dict, List, Optional, Sequence, Tuple

import numpy as np

from ground import _core
from ground.analysis import dictionary, samples
from ground.analysis.distributions import DEVIATIONS
from ground.analysis.folds import excerpt
from ground.analysis.innovations import Innovations
from ground.analysis.likelihood import Likelihood, LikelihoodFit
from ground.analysis.regression import Regression, Term
from ground.analysis.samples import Scales
from ground.analysis.scalars import ARGUMENTS
from ground.analysis.screening import Screen, refined
from ground.analysis.window_error import squared_errors
from ground.poses import scatter
from ground.support.annotations import Array
from ground.support.errors import Diverged

ROUNDS = 4
PROMISING = 200  # single features of the second and later rounds
# A round of the search is kept if the log-likelihood rises by RISE, and another follows above ENOUGH.
RISE, ENOUGH = 2.0, 20.0
SUSPECTS = 3  # features that may be significant by chance
MIN_SHARE = 0.02  # least share that is worth saying


@dataclass(frozen=True)
class Share:
    """Part of the squared error, with its 95% interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class PredictableWrench:
    """What the innovations depend on, after the last round that was kept."""

    regression: Regression
    terms: List[Term]
    fit: LikelihoodFit  # with the wrench as a known input
    wrenches: List[Array]  # of each run (thinned), predicted from the others [N], [N m]


@dataclass(frozen=True)
class Ceiling:
    """What could still be explained, as shares of the error without effects, and of what is left."""

    # mean square of e/s of each window: without effects, with those found, with the wrench too
    squares: Tuple[Array, Array, Array]
    bound: (
        float  # largest share of what is left that the data allow a function of one kind, and what was found
    )
    found: Optional[PredictableWrench]
    runs: Sequence[_core.RunData]  # whole, or stretches of long ones
    cut: Sequence[_core.Window]  # of them

    @property
    def named(self) -> Share:
        """By the effects that were found."""
        return _share(self.squares[0], self.squares[1], self.squares[0])

    @property
    def learnable(self) -> Share:
        """By a function of what was recorded, beside these."""
        start, now, after = self.squares
        return _share(now, after, start, self.bound * float(now.sum() / start.sum()))

    @property
    def chance(self) -> Share:
        """By nothing that was recorded."""
        return _share(self.squares[2], np.zeros(len(self.cut)), self.squares[0])

    @property
    def left(self) -> Share:
        """Learnable part of what the grown model leaves."""
        return _share(self.squares[1], self.squares[2], self.squares[1], self.bound)

    @functools.cached_property
    def arguments(self) -> Dict[str, float]:
        """Part of what is learnable that is lost without the terms of each argument, largest first."""
        if self.found is None:
            return {}
        regression, terms, shares = self.found.regression, self.found.terms, {}
        whole = _explained(regression, terms, terms)
        for name in ARGUMENTS:
            without = [t for t in terms if name not in regression.features[t.columns[0]].arguments]
            if len(without) < len(terms):
                part = 1 - _explained(regression, terms, without) / max(whole, 1e-300)
                shares[name] = float(np.clip(part, 0, 1))
        return dict(sorted(shares.items(), key=lambda item: -item[1]))

    @property
    def of_the_past(self) -> bool:
        """Whether most of it depends on the past."""
        first, share = next(iter(self.arguments.items()), ("", 0.0))
        return first == "past" and share > 0.5

    def reached_by(self, model: _core.Model) -> "Ceiling":
        """The same where a model with a formula explains more than the wrench that was found."""
        start, now, after = self.squares
        reached = _errors_or(now, lambda: squared_errors(self.runs, self.cut, model))
        return replace(self, squares=(start, now, reached)) if reached.sum() < after.sum() else self

    @property
    def is_open(self) -> bool:
        """Whether something may be learnable that runs do not show for certain."""
        return self.found is not None and self.left.value > MIN_SHARE

    @property
    def said(self) -> bool:
        """Whether something learnable is left."""
        return self.is_open and self.left.low > 0


def ceiling(
    likelihood: Likelihood,
    fit: LikelihoodFit,
    runs: Sequence[_core.RunData],
    cut: Sequence[_core.Window],
    before: _core.Model,
    bound: Optional[float] = None,
) -> Ceiling:
    """The Ceiling of a LikelihoodFit to runs. cut: windows of the runs; before: the model without the
    effects found; bound: largest share of what is left that is not the noise of the poses, where that
    explains nearly all: then nothing is searched. Of long runs it takes stretches that are spread evenly."""
    likelihood, fit, runs, cut = excerpt(likelihood, fit, runs, cut)
    now = squared_errors(runs, cut, fit.model)
    start = _errors_or(now, lambda: squared_errors(runs, cut, before))
    if bound is not None:
        return Ceiling((start, now, now), bound, None, runs, cut)
    regression, found = _searched(likelihood, fit)
    if found is None:
        bound = min(1.0, _bound(regression, [], runs, cut, now))
        return Ceiling((start, now, now), bound, None, runs, cut)
    wrenches, model = known_wrenches(found, runs, likelihood), found.fit.model
    after = _errors_or(now, lambda: squared_errors(runs, cut, model, wrenches))
    left = _share(now, after, now)
    # where something acts, and other runs do not show how much of the error it causes, it may be all
    bound = 1.0
    if left.low > 0:
        bound = max(left.high, left.value + _bound(found.regression, found.terms, runs, cut, now))
    return Ceiling((start, now, after), bound, found, runs, cut)


def found_beside(
    likelihood: Likelihood, fit: LikelihoodFit, runs: Sequence[_core.RunData], cut: Sequence[_core.Window]
) -> Optional[PredictableWrench]:
    """What the innovations of a LikelihoodFit depend on, without its shares."""
    return _searched(*excerpt(likelihood, fit, runs, cut)[:2])[1]


def _errors_or(others: Array, errors: Callable[[], Array]) -> Array:
    """Errors of windows; others where the motion is not finite."""
    try:
        return errors()
    except Diverged:
        return others


def _share(worse: Array, better: Array, whole: Array, least: float = -np.inf) -> Share:
    """Fall of the mean error of windows over the whole, with a jackknife over windows. least: upper end."""
    fall, total, count = worse - better, whole.sum(), len(whole)
    value = float(fall.sum() / total)
    others = (fall.sum() - fall) / (total - whole)
    half = DEVIATIONS * float(np.sqrt((count - 1) / count * ((others - others.mean()) ** 2).sum()))
    return Share(value, value - half, min(1.0, max(value + half, least)))


def _searched(likelihood: Likelihood, fit: LikelihoodFit) -> Tuple[Regression, Optional[PredictableWrench]]:
    """The regression of a LikelihoodFit's innovations on the dictionary, and what was found in the last round
    that was kept."""
    sampled = [samples.of_run(likelihood, fit, i) for i in range(len(likelihood.runs))]
    features = dictionary.dictionary(fit.model, Scales.of(sampled))
    innovations = Innovations(likelihood, fit)
    first = regression = Regression(innovations, features, sampled, [len(features)] * len(features))
    best, screen, near = None, Screen(likelihood, fit.model, sampled), fit
    for _ in range(ROUNDS):
        wider = refined(screen.screened(regression))
        terms = wider.choose()
        if not terms:
            break
        wrenches = wider.predicted(terms)
        runs = [
            run.replaced(wrench=wrench, inertial=_core.InertialData())
            for run, wrench in zip(likelihood.runs, wrenches)
        ]
        current = Likelihood(runs, likelihood.craft, likelihood.varying, likelihood.threads)
        try:
            refitted = current.fit(near.model, near.free, near=replace(near, loudness=()))
            rise = refitted.log_posterior - near.log_posterior
            if rise >= RISE:
                best = PredictableWrench(wider, terms, refitted, wrenches)
            if not rise >= ENOUGH:
                break
            regression = wider.again(Innovations(current, refitted), wider.promising(PROMISING, terms))
        except Diverged:  # the motion is not finite
            break
        near = refitted
    return first, best


def known_wrenches(
    found: PredictableWrench, runs: Sequence[_core.RunData], likelihood: Likelihood
) -> List[Array]:
    """The predicted wrench of each run, at all of its samples, with the mean constant wrench of
    the others."""
    trims = found.fit.trims[:, :3]
    constants = (trims.sum(axis=0) - trims) / max(1, len(runs) - 1)
    wrenches = []
    for wrench, constant, run, thin in zip(found.wrenches, constants, runs, likelihood.runs):
        at = np.searchsorted(np.array(thin.times), np.array(run.times), side="right") - 1
        wrenches.append(wrench[np.clip(at, 0, len(thin.times) - 1)] + constant)
    return wrenches


def _explained(regression: Regression, terms: Sequence[Term], of: Sequence[Term]) -> float:
    """Squared change of the innovations by some of the terms, without what the parameters can follow."""
    at, _, weights = regression.posterior(terms)
    kept = np.isin(at, [j for term in of for j in term.columns])
    return float(((regression.D[:, at[kept]] @ weights[kept]) ** 2).sum())


# The upper bound of what was not found


def _bound(
    regression: Regression,
    terms: Sequence[Term],
    runs: Sequence[_core.RunData],
    cut: Sequence[_core.Window],
    now: Array,
) -> float:
    """Largest share of the error that a family of features explains beside terms, at the largest size that
    the likelihood does not exclude. Beside no terms the most significant features count, too, at their
    likeliest size: they may be significant by chance."""
    moved, beside, shares = _moved(regression, runs, cut), regression.posterior(terms), [0.0]
    for j in np.argsort(-regression.significance(beside))[: 0 if terms else SUSPECTS]:
        weight = regression.b[j] / max(float(regression.information[j]), 1e-300)
        shares.append(float(((weight * moved[:, j]) ** 2).sum() / now.sum()))
    for family in regression.families:
        size = regression.largest(family.columns, DEVIATIONS**2, beside)
        if size > 0:
            at, covariance, mean = regression.posterior([*terms, replace(family, variance=size)])
            own = np.isin(at, family.columns)
            S = moved[:, at[own]]
            power = ((S @ mean[own]) ** 2).sum() + ((S @ covariance[np.ix_(own, own)]) * S).sum()
            shares.append(float(power / now.sum()))
    return min(1.0, max(shares))


def _moved(regression: Regression, runs: Sequence[_core.RunData], cut: Sequence[_core.Window]) -> Array:
    """Change of the velocities over windows, relative to their standard deviations, by each
    feature of a mean square of one. It moves as a damped mass in each direction."""
    model, rows = regression.model, []
    inertia = np.array([model.value("m"), model.value("m"), model.value("I_z")])
    rates = np.array([model.value(name) for name in ("X_u", "Y_v", "N_r")]) / inertia
    for window in cut:
        i, run = window.run, regression.innovations.likelihood.runs[window.run]  # thinned
        times = np.array(run.times)
        first, last = np.searchsorted(times, [runs[i].times[k] for k in (window.first, window.last)])
        since = times[first:last, None] - times[None, first:last]
        step = scatter.interval(times)
        sigma = np.array(run.nu).std(axis=0)
        for c in range(3):
            response = np.where(since >= 0, np.exp(-rates[c] * np.maximum(since, 0)), 0.0)
            response -= response.mean(axis=0)  # the initial velocity takes up a constant
            response *= step * regression.full[c] / inertia[c] / sigma[c] / np.sqrt(max(1, last - first))
            start = regression.edges[i]
            rows.append(response @ regression.wrenches[start + first : start + last, c])
    return np.vstack(rows) * regression.scale
