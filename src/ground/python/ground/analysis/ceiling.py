"""The ceiling of a model: how much of its error any function of what was recorded could still explain.

A regression of the innovations (ground.analysis.regression) finds what they depend on. Its wrench
for each run is estimated from the other runs (from the other quarters of a single run) and handed
to the filter as a known input; levels and parameters are fitted again, and the regression
repeated: a large wrench is hidden in the levels of the disturbance at first. A round is kept if
the likelihood of the poses rises.

Shares are of the squared error of simulated velocities over windows, each relative to its standard
deviation in the run: *named* by the effects that were found, *learnable*, and *chance*, which
nothing recorded predicts.
"""

from dataclasses import dataclass, replace
from typing import Callable, Dict, List, Optional, Sequence, Tuple

import numpy as np

from ground import _core
from ground.analysis import dictionary, samples
from ground.analysis.folds import excerpt
from ground.analysis.likelihood import Fit, Likelihood
from ground.analysis.regression import Regression, Term
from ground.analysis.samples import Samples, Scales
from ground.analysis.scalars import ARGUMENTS, PAST
from ground.analysis.screening import Screen, refined
from ground.analysis.window_error import squared_errors
from ground.recordings import scatter
from ground.support.annotations import Array
from ground.support.errors import GroundError

ROUNDS = 4
PROMISING = 200  # single features of the second and later rounds
# A round of the search is kept if the log-likelihood rises by RISE, and another follows above ENOUGH.
RISE, ENOUGH = 2.0, 20.0
DEVIATIONS = 1.96
BEHIND = 3.84  # log-likelihood ratio of the largest size of a wrench that the data do not exclude
MOSTLY = 0.5  # part of what is learnable
SUSPECTS = 3  # features that may be significant by chance
MIN_SHARE = 0.02  # least share that is worth saying


@dataclass(frozen=True)
class Share:
    """Part of the squared error, with its 95% interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Found:
    """What the innovations depend on, after the last round that was kept."""

    regression: Regression
    terms: List[Term]
    fit: Fit  # with the wrench as a known input
    wrenches: List[Array]  # of each run (thinned), predicted from the others [N], [N m]
    arguments: Dict[str, float]  # part of it that each accounts for, largest first


@dataclass(frozen=True)
class Ceiling:
    """What could still be explained."""

    named: Share
    learnable: Share
    chance: Share
    left: Share  # learnable part of what the grown model leaves
    arguments: Dict[str, float]  # part of the learnable share that each accounts for
    found: Optional[Found]
    # largest share of what is left that the data allow a function of one kind, and what was found
    bound: float
    squares: Tuple[Array, Array, Array]  # mean square of e/s of each window: before, with the effects, with
    # the wrench too
    runs: Sequence[_core.RunData]  # whole, or stretches of long ones
    cut: Sequence[_core.Window]  # of them

    @property
    def of_the_past(self) -> bool:
        """Whether most of it depends on the past."""
        shares = list(self.arguments.items())
        return bool(shares) and shares[0][0] == PAST and shares[0][1] > MOSTLY

    def unbounded(self) -> "Ceiling":
        """The same where nothing tells what the rest is: all of it may be learnable."""
        return replace(
            self,
            learnable=replace(self.learnable, high=self.learnable.value + self.chance.value),
            left=replace(self.left, high=1.0),
            bound=1.0,
        )

    def reached_by(self, model: _core.Model) -> "Ceiling":
        """The same where a model with a formula explains more than the wrench that was found."""
        start, now, after = self.squares
        reached = _errors_or(now, lambda: squared_errors(self.runs, self.cut, model))
        if reached.sum() >= after.sum():
            return self
        learnable, left = _share(now, reached, start), _share(now, reached, now)
        return replace(
            self,
            learnable=replace(learnable, high=max(learnable.high, self.learnable.high)),
            chance=_share(reached, np.zeros_like(reached), start),
            left=replace(left, high=max(left.high, self.left.high)),
            squares=(start, now, reached),
        )

    @property
    def is_open(self) -> bool:
        """Whether something may be learnable that runs do not show for certain."""
        return self.found is not None and self.left.value > MIN_SHARE

    @property
    def said(self) -> bool:
        """Whether something learnable is left."""
        return self.found is not None and self.left.value > MIN_SHARE and self.left.low > 0


def ceiling(
    likelihood: Likelihood,
    fit: Fit,
    runs: Sequence[_core.RunData],
    cut: Sequence[_core.Window],
    before: _core.Model,
    bound: Optional[float] = None,
) -> Ceiling:
    """The Ceiling of a Fit to runs. cut: windows of the runs; before: the model without the
    effects found; bound: largest share of what is left that is not the noise of the poses, where that
    explains nearly all: then nothing is searched. Of long runs it takes stretches that are spread evenly."""
    likelihood, fit, runs, cut = excerpt(likelihood, fit, runs, cut)
    found = None
    if bound is None:
        first, sampled = _first(likelihood, fit)
        found = _rounds(first, sampled)
    now = squared_errors(runs, cut, fit.model)
    start = _errors_or(now, lambda: squared_errors(runs, cut, before))
    wrenches = None if found is None else known_wrenches(found, runs, likelihood)
    after = now
    if found is not None:
        model = found.fit.model
        after = _errors_or(now, lambda: squared_errors(runs, cut, model, wrenches))
    left = _share(now, after, now)
    if bound is None:
        bound = 1.0  # if something acts, and other runs do not tell how much of the error it causes
        if found is None:
            bound = max(left.high, _bound(first, [], runs, cut, now))
        elif left.low > 0:
            bound = max(left.high, left.value + _bound(found.regression, found.terms, runs, cut, now))
    whole = start.sum()
    learnable = _share(now, after, start)
    return Ceiling(
        _share(start, now, start),
        replace(learnable, high=min(1.0, max(learnable.high, bound * now.sum() / whole))),
        _share(after, np.zeros_like(after), start),
        replace(left, high=min(1.0, bound)),
        found.arguments if found else {},
        found,
        bound,
        (start, now, after),
        runs,
        cut,
    )


def found_beside(
    likelihood: Likelihood, fit: Fit, runs: Sequence[_core.RunData], cut: Sequence[_core.Window]
) -> Optional[Found]:
    """What the innovations of a Fit depend on, without its shares."""
    likelihood, fit, _, _ = excerpt(likelihood, fit, runs, cut)
    return _rounds(*_first(likelihood, fit))


def _first(likelihood: Likelihood, fit: Fit) -> Tuple[Regression, List[Samples]]:
    """The Regression on the dictionary, and the Samples of each run."""
    sampled = [samples.of_run(likelihood, fit, i) for i in range(len(likelihood.runs))]
    features = dictionary.dictionary(fit.model, Scales.of(sampled))
    acting = [dictionary.wrenches(features, fit.model, s) for s in sampled]
    followed = [dictionary.followed(fit.model, s) for s in sampled]
    return Regression(likelihood, fit, features, acting, followed), sampled


def _errors_or(others: Array, errors: Callable[[], Array]) -> Array:
    """Errors of windows; others where the motion is not finite."""
    try:
        return errors()
    except GroundError:
        return others


def _share(worse: Array, better: Array, whole: Array) -> Share:
    """Fall of the mean error of windows over the whole, with a jackknife over windows."""
    fall, total, count = worse - better, whole.sum(), len(whole)
    value = float(fall.sum() / total)
    others = (fall.sum() - fall) / (total - whole)
    deviation = float(np.sqrt((count - 1) / count * ((others - others.mean()) ** 2).sum()))
    return Share(value, value - DEVIATIONS * deviation, min(1.0, value + DEVIATIONS * deviation))


def _rounds(first: Regression, sampled: Sequence[Samples]) -> Optional[Found]:
    """What was found in the last round that was kept. sampled: of each run."""
    likelihood, near = first.likelihood, first.fit
    best: Optional[Found] = None
    regression, screen = first, Screen(likelihood, near.model, sampled)
    for _ in range(ROUNDS):
        wider = refined(screen.screened(regression, near.model), near.model, sampled)
        parts = wider.parts()
        terms = wider.choose(parts)
        if not terms:
            break
        wrenches = wider.predicted(terms, parts)
        current = Likelihood(
            [with_known(run, w) for run, w in zip(likelihood.runs, wrenches)],
            likelihood.craft,
            likelihood.varying,
            likelihood.threads,
        )
        try:
            refitted = current.fit(near.model, near.free, near=replace(near, loudness=()))
        except GroundError:
            break
        rise = refitted.log_posterior - near.log_posterior
        if rise < RISE:
            break
        best = Found(wider, terms, refitted, wrenches, _arguments(wider, terms))
        if rise < ENOUGH:
            break
        try:
            regression = wider.again(current, refitted, wider.promising(PROMISING, terms))
        except GroundError:  # the motion is not finite
            break
        near = refitted
    return best


def with_known(run: _core.RunData, wrench: Array) -> _core.RunData:
    """A run on which a known wrench (n, 3) acts."""
    return run.replaced(wrench=wrench, inertial=_core.InertialData())


def known_wrenches(found: Found, runs: Sequence[_core.RunData], likelihood: Likelihood) -> List[Array]:
    """The predicted wrench of each run, at all of its samples, with the mean constant wrench of
    the others."""
    trims = np.array([trim["wrench"] for trim in found.fit.trims])
    constants = (trims.sum(axis=0) - trims) / max(1, len(runs) - 1)
    whole = [_at_all(*given) for given in zip(found.wrenches, runs, likelihood.runs)]
    return [wrench + constant for wrench, constant in zip(whole, constants)]


def _at_all(wrench: Array, run: _core.RunData, thin: _core.RunData) -> Array:
    """The wrench at the samples of a thinned run, at all samples of the run."""
    at = np.searchsorted(np.array(thin.times), np.array(run.times), side="right") - 1
    return np.asarray(wrench[np.clip(at, 0, len(thin.times) - 1)])


def _arguments(regression: Regression, terms: Sequence[Term]) -> Dict[str, float]:
    """Part of the explained variance that is lost without the terms of each argument."""
    shares: Dict[str, float] = {}
    whole = _explained(regression, terms, terms)
    for name in ARGUMENTS:
        without = [t for t in terms if name not in regression.arguments(t)]
        if len(without) < len(terms):
            part = 1 - _explained(regression, terms, without) / max(whole, 1e-300)
            shares[name] = float(np.clip(part, 0, 1))
    return dict(sorted(shares.items(), key=lambda item: -item[1]))


def _explained(regression: Regression, terms: Sequence[Term], of: Sequence[Term]) -> float:
    """Squared change of the innovations by some of the terms, without what the parameters can follow."""
    at, _, weights = regression.posterior(terms)
    kept = np.isin(at, np.concatenate([t.columns for t in of])) if of else np.zeros(len(at), bool)
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
    moved, shares = _moved(regression, runs, cut), [0.0]
    for j in np.argsort(-regression.significance())[: 0 if terms else SUSPECTS]:
        weight = regression.b[j] / max(float(regression.information[j]), 1e-300)
        power = ((weight * regression.scale[j] * moved[:, j]) ** 2).sum()
        shares.append(float(power / now.sum()))
    for family in regression.terms:
        size = regression.largest(family.columns, BEHIND, terms)
        if size > 0:
            at, covariance, mean = regression.posterior([*terms, replace(family, variance=size)])
            own = np.flatnonzero(np.isin(at, family.columns))
            at, covariance, mean = at[own], covariance[np.ix_(own, own)], mean[own]
            S = moved[:, at] * regression.scale[at]
            power = ((S @ mean) ** 2).sum() + ((S @ covariance) * S).sum()
            shares.append(float(power / now.sum()))
    return min(1.0, max(shares))


def _moved(regression: Regression, runs: Sequence[_core.RunData], cut: Sequence[_core.Window]) -> Array:
    """Change of the velocities over windows, relative to their standard deviations, by each
    feature of size one. The motion is that of a damped mass in each direction."""
    model, rows = regression.fit.model, []
    inertia = np.array([model.value("m"), model.value("m"), model.value("I_z")])
    rates = np.array([model.value(name) for name in ("X_u", "Y_v", "N_r")]) / inertia
    for window in cut:
        i, run = window.run, regression.likelihood.runs[window.run]  # thinned
        times = np.array(run.times)
        first, last = np.searchsorted(times, [runs[i].times[k] for k in (window.first, window.last)])
        since = times[first:last, None] - times[None, first:last]
        step = scatter.interval(times)
        sigma = np.array(run.nu).std(axis=0)
        for c in range(3):
            response = np.where(since >= 0, np.exp(-rates[c] * np.maximum(since, 0)), 0.0)
            response -= response.mean(axis=0)  # the initial velocity takes up a constant
            response *= step * regression.full[c] / inertia[c] / sigma[c] / np.sqrt(max(1, last - first))
            rows.append(response @ regression.wrenches[i][first:last, c])
    return np.vstack(rows)
