"""Data that are held out of a fit: which parts, and how well models predict what they were not fitted to."""

from dataclasses import dataclass, replace
from typing import Dict, List, Optional, Sequence, Tuple

import numpy as np

from ground import _core
from ground.analysis import window_error, windows
from ground.analysis.horizon import Starts
from ground.analysis.judge import Tested
from ground.analysis.likelihood import Likelihood, LikelihoodFit
from ground.analysis.thinning import at_samples
from ground.effect_library.parameters import FittedParameter
from ground.support.annotations import Array, Each
from ground.support.errors import Diverged

MOST_SAMPLES = 6000  # poses, thinned, in an excerpt of runs


@dataclass(frozen=True)
class Judged:
    """A fitted model and its errors."""

    model: _core.Model
    parameters: Sequence[FittedParameter]
    error: Array  # (3,) mean |e|/s of u, v, r over the windows of all runs
    heldout: Array  # (3,) the same, each window by a fit to the other parts; differences between
    # runs are estimated from the run's poses before the window (window_error.calibrated_errors)
    tested: Tested  # by the fits to the other parts
    fit: Optional[LikelihoodFit] = None  # None: fitted by simulation error
    others: Sequence[LikelihoodFit] = ()  # the fits to all but each part

    @property
    def by(self) -> str:
        """What the fit maximises or minimises."""
        return "likelihood" if self.fit else "simulation"


class Folds:
    """Runs (_core.RunData) split into folds: by run, or a single run by quarters of its time.

    whole: their Likelihood; cut: the windows that errors are taken over; at: Starts of predictions; each:
    maps a function over items, in parallel if it can.
    """

    def __init__(
        self,
        runs: Sequence[_core.RunData],
        whole: Likelihood,
        cut: Sequence[_core.Window],
        at: Starts,
        each: Each = map,
    ) -> None:
        self.runs, self.whole, self.cut, self.at, self.each = runs, whole, cut, at, each
        # the whole's runs are thinned already; a quarter is thinned by itself
        parts = list(whole.runs)
        if len(runs) == 1:
            edges = np.linspace(0, len(runs[0].times), window_error.PARTS + 1).astype(int)
            parts = [at_samples(runs[0], slice(a, b)) for a, b in zip(edges[:-1], edges[1:])]
        self.count = min(window_error.PARTS, len(parts))

        def likelihood(chosen: Sequence[_core.RunData]) -> Likelihood:
            return Likelihood(chosen, whole.craft, whole.varying, whole.threads)

        folds = range(self.count)
        self.fitted = [likelihood([p for i, p in enumerate(parts) if i % self.count != f]) for f in folds]
        self.tested = [likelihood(parts[f :: self.count]) for f in folds]
        self.fold_of = window_error.parts_of(runs, cut)
        self.start_of = window_error.parts_of(runs, at.windows)
        self._tests: Dict[LikelihoodFit, Tuple[Tested, Sequence[LikelihoodFit]]] = {}

    def models(self, fit: LikelihoodFit) -> List[LikelihoodFit]:
        """Models refitted without each fold, starting from a LikelihoodFit to all runs; its levels are kept.
        Raises GroundError where one cannot be simulated."""
        return list(self.each(lambda fold: self._without(fold, fit), range(self.count)))

    def _without(self, fold: int, fit: LikelihoodFit) -> LikelihoodFit:
        """A LikelihoodFit refitted without a fold. The noise of each run is found anew; where the motion is
        not finite without it, the search starts from the noise of the Fit."""
        own = fit.loudness * (self.count - 1)
        if len(self.runs) > 1:
            own = tuple(noise for run, noise in enumerate(fit.loudness) if run % self.count != fold)

        def refitted(loudness: Tuple[float, ...]) -> LikelihoodFit:
            near = replace(fit, loudness=loudness)
            return self.fitted[fold].fit(fit.model, fit.free, near=near, levels=False)

        try:
            return refitted(())
        except Diverged:
            return refitted(own)

    def judge(self, fit: LikelihoodFit) -> Judged:
        """The Judged of a LikelihoodFit to all runs. Its errors are infinite where a motion is not finite:
        the filter of a likelihood holds an unstable model at what was measured, and predictions do not."""
        tested, refitted = self.test(fit)
        try:
            error = window_error.channel_errors(self.runs, self.cut, fit.model)
        except Diverged:
            never = np.full(3, np.inf)
            return Judged(fit.model, fit.parameters, never, never, self._never(), fit, refitted)
        heldout = np.zeros((len(self.cut), 3))
        for fold, other in enumerate(refitted):
            inside = np.flatnonzero(self.fold_of == fold)
            if len(inside):
                own = [self.cut[i] for i in inside]
                heldout[inside] = window_error.calibrated_errors(self.runs, own, self.whole, other)
        mean = window_error.mean(self.cut, heldout)
        return Judged(fit.model, fit.parameters, error, mean, tested, fit, refitted)

    def test(self, fit: LikelihoodFit) -> Tuple[Tested, Sequence[LikelihoodFit]]:
        """What a LikelihoodFit's refits to all but each part predict of it, and these refits."""
        if fit not in self._tests:
            try:
                refitted = self.models(fit)
                self._tests[fit] = self._tested(refitted), refitted
            except Diverged:
                self._tests[fit] = self._never(), [fit] * self.count
        return self._tests[fit]

    def _never(self) -> Tested:
        """Of a motion that is not finite."""
        errors = np.full((len(self.at.windows), 2), np.inf)
        return Tested(errors, self.start_of, (np.array([-np.inf]),) * self.count)

    def judge_simulated(self, fit: LikelihoodFit, found: window_error.WindowFit) -> Judged:
        """The Judged of a model that was fitted by simulation error to the windows; fit: a LikelihoodFit of
        the levels beside it, without a free parameter."""
        others = [
            self._without(fold, replace(fit, model=found.others[fold].model)) for fold in range(self.count)
        ]
        return judged_windows(found, self._tested(others), others)

    def _tested(self, fits: Sequence[LikelihoodFit]) -> Tested:
        """What Fits to all but each part predict of it."""
        blocks = self.each(lambda pair: np.concatenate(_blocks_of(*pair)), zip(self.tested, fits))
        models: List[_core.Model] = [fits[0].model] * len(self.at.windows)
        for fold, fit in enumerate(fits):
            inside = np.flatnonzero(self.start_of == fold)
            own = [self.at.windows[i] for i in inside]
            for i, model in zip(inside, window_error.calibrated_models(self.runs, own, self.whole, fit)):
                models[i] = model
        return Tested(self.at.errors(self.runs, models), self.start_of, tuple(blocks))


def judged_windows(
    found: window_error.WindowFit, tested: Tested, others: Sequence[LikelihoodFit] = ()
) -> Judged:
    """The Judged of a model that was fitted by simulation error."""
    return Judged(found.model, found.parameters, found.error, found.heldout, tested, None, others)


def _blocks_of(likelihood: Likelihood, fit: LikelihoodFit) -> List[Array]:
    """Log-likelihood of the blocks of each run by a LikelihoodFit to others. Noise and disturbance are fitted
    to these runs themselves, because the motion is evaluated. A model with a small disturbance would
    otherwise be too sure of runs that differ from the fitted ones. -inf for all blocks of a run together
    where the motion is not finite."""
    try:
        own = likelihood.fit(fit.model, [], near=replace(fit, loudness=()))
        return likelihood.blocks(own, own.loudness)
    except Diverged:
        return [np.array([-np.inf])] * len(likelihood.runs)


def tested(runs: Sequence[_core.RunData], at: Starts, likelihood: Likelihood, fit: LikelihoodFit) -> Tested:
    """A LikelihoodFit on runs that it was not fitted to, as it is; likelihood: of these runs; at: their
    Starts."""
    models = window_error.calibrated_models(runs, at.windows, likelihood, fit)
    return Tested(at.errors(runs, models), at.of_run, tuple(_blocks_of(likelihood, fit)))


def excerpt(
    likelihood: Likelihood,
    fit: LikelihoodFit,
    runs: Sequence[_core.RunData],
    cut: Sequence[_core.Window],
) -> Tuple[Likelihood, LikelihoodFit, Sequence[_core.RunData], Sequence[_core.Window]]:
    """The same if the runs are short together, else stretches of them that are spread evenly."""
    samples = sum(len(run.times) for run in likelihood.runs)
    if samples <= MOST_SAMPLES:
        return likelihood, fit, runs, cut
    seconds = 10 * windows.time_scale(runs)  # of a stretch: long beside what the craft remembers
    stretches = [
        (i, begin)
        for i, run in enumerate(runs)
        for begin in np.arange(run.times[0], run.times[-1] - seconds / 2, seconds).tolist()
    ]
    duration = sum(max(run.times[-1] - run.times[0], 1e-3) for run in runs)
    most = int(np.clip(MOST_SAMPLES / (samples / duration * seconds), 2, len(stretches)))
    pieces, of = [], []
    for k in np.linspace(0, len(stretches) - 1, most).astype(int):
        i, begin = stretches[k]
        first, last = np.searchsorted(runs[i].times, [begin, begin + seconds])
        piece = at_samples(runs[i], slice(int(first), int(last)))
        if windows.cut_part(piece, 0, piece.times[0], piece.times[-1]):
            pieces.append(piece)
            of.append(i)
    if len(pieces) < 2:
        return likelihood, fit, runs, cut
    shorter = Likelihood(pieces, likelihood.craft, likelihood.varying, likelihood.threads)
    loudness = tuple(fit.loudness[i] for i in of) if fit.loudness else ()
    return shorter, replace(fit, loudness=loudness, trims=fit.trims[of]), pieces, windows.cut(pieces)
