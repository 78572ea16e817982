"""Simulation error and log-likelihood of models on runs that they were not fitted to."""

import dataclasses
import functools
from dataclasses import dataclass
from typing import Callable, Dict, List, Sequence, Tuple

import numpy as np

from ground import _core
from ground.analysis import study
from ground.analysis.distributions import mean_not_above_zero
from ground.analysis.likelihood import Fit, Likelihood
from ground.annotations import Array, Document, Each, Indices
from ground.errors import GroundError

FOLDS = 4  # largest number of folds
BETTER, UNDECIDED, WORSE = "better", "undecided", "worse"  # verdicts of a Comparison
MIN_PARTS = 4  # from which on a t-test over parts has power
MAX_CHANCE = 0.05  # probability with which a Comparison may say "worse" where nothing differs


@dataclass
class Judged:
    """A fitted model and its errors."""

    model: _core.Model
    parameters: Dict[
        str, Document
    ]  # by name: value, unit, ci95, deviation, identified, at_bound
    error: Array  # (3,) mean |e|/s of u, v, r over the windows of all runs
    heldout: Array  # (3,) the same, each window by a fit to the other parts; differences between
    # runs are estimated from the run's poses before the window (study.calibrated_errors)
    by_window: Array  # (windows,) sum of the held-out errors of u, v, r in each window
    likelihood: Tuple[Array, ...]  # for each part: held-out log-likelihood of its blocks of time
    part_of: Indices  # (windows,) part that each window is in

    @property
    def tested(self) -> "Tested":
        """How well it predicts what it was not fitted to."""
        return Tested(self.by_window, self.part_of, self.likelihood)


@dataclass(frozen=True)
class Tested:
    """Errors and log-likelihood of a model on parts of data that it was not fitted to."""

    by_window: Array  # (windows,) sum of the errors of u, v, r in each window
    part_of: Indices  # (windows,) part that each window is in
    likelihood: Tuple[Array, ...]  # for each part: log-likelihood of its blocks of time


@dataclass(frozen=True)
class Comparison:
    """Paired comparison of two models on held-out data: with an effect, and without it."""

    verdict: str  # BETTER, UNDECIDED or WORSE with the effect
    gain: float  # rise of the log-likelihood
    gain_error: float  # its standard error, by blocks of time
    rise: float  # rise of the mean error over windows
    rise_error: float  # its standard error


class Folds:
    """Runs (_core.RunData) split into folds: by run, or a single run by quarters of its time.

    whole: their Likelihood; craft: as for Likelihood; cut: the windows that errors are taken over;
    each: maps a function over items, in parallel if it can.
    """

    def __init__(
        self,
        runs: Sequence[_core.RunData],
        whole: Likelihood,
        craft: _core.Model,
        cut: Sequence[_core.Window],
        each: Each = map,
    ) -> None:
        self.runs, self.whole, self.cut, self.each = runs, whole, cut, each
        # the whole's runs are thinned already; a quarter is thinned by itself
        self.parts = [[run] for run in whole.runs] if len(runs) > 1 else quarters(runs[0])
        self.count = min(FOLDS, len(self.parts))
        self.fitted: List[Likelihood] = []
        self.tested: List[Likelihood] = []
        for fold in range(self.count):
            inside = [part for i, part in enumerate(self.parts) if i % self.count == fold]
            outside = [part for i, part in enumerate(self.parts) if i % self.count != fold]
            for parts, likelihoods in ((outside, self.fitted), (inside, self.tested)):
                chosen = [run for part in parts for run in part]
                likelihoods.append(Likelihood(chosen, craft, whole.varying, whole.threads))
        self.fold_of = np.array([self._fold_of(w) for w in cut])

    def _fold_of(self, window: _core.Window) -> int:
        if len(self.runs) > 1:
            return window.run % self.count
        ends = [part[-1].times[-1] for part in self.parts]
        middle = self.runs[0].times[(window.first + window.last) // 2]
        return min(int(np.searchsorted(ends, middle)), self.count - 1)

    def models(self, fit: Fit) -> List[Fit]:
        """Models refitted without each fold, starting from a Fit to all runs; its levels are kept."""
        return list(self.each(functools.partial(_refitted, self.fitted, fit), range(self.count)))

    def judge(self, fit: Fit) -> Judged:
        """The Judged of a Fit to all runs."""
        refitted = self.models(fit)
        heldout = self._errors(refitted)
        return Judged(
            fit.model,
            {p["name"]: p for p in fit.parameters},
            study.channel_errors(self.runs, self.cut, fit.model),
            self._mean(heldout),
            heldout.sum(axis=1),
            tuple(self.each(functools.partial(_blocks, self.tested, refitted), range(self.count))),
            self.fold_of,
        )

    def nested(self, choose: Callable[[Likelihood], Fit], each: Each = map) -> Array:
        """Mean |e|/s (3,) over windows, each by a model that was chosen and fitted without it.
        choose(likelihood) returns the Fit for the Likelihood of the other parts; `each` maps it."""
        return self.error(list(each(choose, self.fitted)))

    def error(self, fits: Sequence[Fit]) -> Array:
        """Mean |e|/s (3,) over windows, each by the Fit to the parts without it."""
        return self._mean(self._errors(fits))

    def _errors(self, fits: Sequence[Fit]) -> Array:
        """Errors (windows, 3), each window by the Fit to the parts without it."""
        heldout = np.zeros((len(self.cut), 3))
        for fold, fit in enumerate(fits):
            inside = np.flatnonzero(self.fold_of == fold)
            if len(inside):
                chosen = [self.cut[i] for i in inside]
                try:
                    heldout[inside] = study.calibrated_errors(self.runs, chosen, self.whole, fit)
                except GroundError:  # its motion on the held-out part is not finite
                    heldout[inside] = np.inf
        return heldout

    def _mean(self, errors: Array) -> Array:
        samples = [w.last - w.first + 1 for w in self.cut]
        return np.asarray(np.average(errors, axis=0, weights=samples))


def _refitted(fitted: Sequence[Likelihood], fit: Fit, fold: int) -> Fit:
    """A Fit to all runs, its parameters refitted without a fold."""
    near = dataclasses.replace(fit, loudness=())
    return fitted[fold].fit(fit.model, fit.free, near=near, levels=False)


def _blocks(tested: Sequence[Likelihood], fits: Sequence[Fit], fold: int) -> Array:
    """Log-likelihood of a fold's blocks by a Fit to the others."""
    return np.concatenate(_blocks_of(tested[fold], fits[fold]))


def _blocks_of(likelihood: Likelihood, fit: Fit) -> List[Array]:
    """Log-likelihood of the blocks of each run by a Fit to others. Noise and disturbance are those of
    these runs themselves: what is judged is the motion, and a model that leaves less to the
    disturbance would else be too sure of runs that differ from those it was fitted to. -inf for all
    blocks of a run together where the motion is not finite."""
    try:
        own = likelihood.fit(fit.model, [], near=dataclasses.replace(fit, loudness=()))
        return likelihood.blocks(own, own.loudness)
    except GroundError:
        return [np.array([-np.inf])] * len(likelihood.runs)


def tested(
    runs: Sequence[_core.RunData],
    cut: Sequence[_core.Window],
    likelihood: Likelihood,
    fit: Fit,
) -> Tested:
    """A Fit on windows of runs that it was not fitted to, as it is; likelihood: of these runs."""
    try:
        errors = study.calibrated_errors(runs, cut, likelihood, fit).sum(axis=1)
    except GroundError:  # its motion is not finite
        errors = np.full(len(cut), np.inf)
    return Tested(errors, np.array([w.run for w in cut]), tuple(_blocks_of(likelihood, fit)))


def compared(larger: Tested, smaller: Tested) -> Comparison:
    """Comparison of a model with an effect and one without it on the same held-out data."""
    gain, gain_error = _gain(larger, smaller)
    if not np.isfinite(gain):  # the motion is not finite with one of them, or with both
        return Comparison(BETTER if gain > 0 else WORSE, gain, 0.0, -gain, 0.0)
    blocks = [b - w for b, w in zip(larger.likelihood, smaller.likelihood)]
    off = larger.by_window - smaller.by_window
    parts = [off[larger.part_of == part] for part in np.unique(larger.part_of)]
    worse = _is_below_zero(blocks) or _is_below_zero([-part for part in parts])
    verdict = WORSE if worse else BETTER if gain > gain_error else UNDECIDED
    rise, error = float(off.mean()), np.inf
    if len(off) > 1 and np.isfinite(rise):
        error = off.std(ddof=1) / np.sqrt(len(off))
    return Comparison(verdict, gain, gain_error, rise, float(error))


def _is_below_zero(parts: Sequence[Array]) -> bool:
    """Whether the mean of values in parts of data is significantly below zero. Neighbouring values may
    be correlated, so that sums of many values have to show it, too: of whole parts, or of pieces of
    few parts, which then have to agree."""
    values = np.concatenate(parts)
    if not np.isfinite(values).all():
        return bool(values.sum() < 0)
    sums = [part.sum() for part in parts]
    if len(parts) < MIN_PARTS:
        if max(sums) > 0:
            return False
        sums = [p.sum() for part in parts for p in np.array_split(part, MIN_PARTS) if len(p)]
    return all(mean_not_above_zero(-v) < MAX_CHANCE for v in (values, np.array(sums)))


def _gain(better: Tested, worse: Tested) -> Tuple[float, float]:
    """Rise of the held-out log-likelihood from one model to another, and its standard error."""
    sums = [np.concatenate(found.likelihood).sum() for found in (better, worse)]
    if not np.isfinite(sums).all():
        return (float(sums[0] - sums[1]) if sums[0] != sums[1] else -np.inf), 0.0
    rise = np.concatenate(better.likelihood) - np.concatenate(worse.likelihood)
    return float(rise.sum()), (
        float(rise.std(ddof=1) * np.sqrt(len(rise))) if len(rise) > 1 else np.inf
    )


def share_raised(better: Judged, worse: Judged) -> float:
    """Share of the parts held out that are likelier by one Judged than by another."""
    rises = [b.sum() - w.sum() for b, w in zip(better.likelihood, worse.likelihood)]
    return float(np.mean(np.array(rises) > 0))


def quarters(run: _core.RunData, count: int = 4) -> List[List[_core.RunData]]:
    """A run split into `count` stretches of time: lists of one _core.RunData."""
    times = np.array(run.times)
    edges = np.linspace(0, len(times), count + 1).astype(int)
    return [[stretch(run, times, slice(a, b))] for a, b in zip(edges[:-1], edges[1:])]


def stretch(run: _core.RunData, times: Array, part: slice) -> _core.RunData:
    """Some samples of a run; times: all of its instants."""
    poses = np.array(run.poses)
    return _core.RunData(
        run.name,
        times[part],
        np.array(run.eta)[part],
        np.array(run.nu)[part],
        np.array(run.inputs),
        poses[part] if len(poses) else poses,
        np.array(run.noise),
        run.drives,
    )
