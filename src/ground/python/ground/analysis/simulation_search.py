"""A search for missing effects by simulation error, for recordings whose likelihood misleads.

The likelihood of poses lets a random disturbance push the craft. Where poses wander for other reasons, as in
waves or by the slow errors of a position filter, a light craft that is pushed explains them best, and the
effects that suit it predict worse than the model without them. Simulation error does without a disturbance.

Forward steps, and a look back: each effect is fitted beside those found, the best are cross-validated, and
the best of these stays if data that it was not fitted to show it, corrected for the number of effects tried.
"""

from typing import Callable, Dict, FrozenSet, List, Optional, Sequence

import numpy as np

from ground import _core
from ground.analysis.distributions import LEVEL, mean_not_above_zero
from ground.analysis.judge import PairedComparison
from ground.analysis.search import REFITTED
from ground.analysis.window_error import WindowFit, WindowFitter, channel_errors, free_parameters
from ground.effect_library.candidates import Candidate
from ground.support.annotations import Each
from ground.support.errors import Diverged
from ground.support.progress import Work


class SimulationSearch:
    """Effects added to a model by the simulation error of a fitter. tried: those to choose from; each: maps
    fits over effects, in parallel if it can; work: told of what is done; compared(larger, smaller): the
    judge; matters(smaller, larger): whether what a model predicts differs enough from what another does."""

    def __init__(
        self,
        fitter: WindowFitter,
        given: _core.Model,
        tried: Sequence[Candidate],
        compared: Callable[[WindowFit, WindowFit], PairedComparison],
        matters: Callable[[_core.Model, _core.Model], bool],
        each: Each = map,
        work: Optional[Work] = None,
    ) -> None:
        self.fitter, self.given, self.each = fitter, given, each
        self.compared, self.matters = compared, matters
        self.candidates = {candidate.name: candidate for candidate in tried}
        self.work = work or Work()
        self.fits: Dict[FrozenSet[str], WindowFit] = {}  # cross-validated

    def run(self) -> List[str]:
        """The effects in the order of their steps; empty if none helps. GroundError when a motion is not
        finite."""
        self.fits[frozenset()] = self.fitter.fit(self.given, free_parameters(self.given))
        found: List[str] = []
        while True:
            better = self._next(found)
            if better is None:
                break
            found.append(better)
            self.work.note("with %s, by simulation error" % ", ".join(found))
        for name in found[:-1]:  # what an effect that was found later may explain better
            whole = frozenset(found)
            if self._finite(whole - {name}) and not self._helps(whole, whole - {name}):
                found.remove(name)
        return found

    def _next(self, found: Sequence[str]) -> Optional[str]:
        """The effect that lowers the error of held-out data most; None if none does for certain."""
        base = frozenset(found)
        fitted = self.each(lambda name: (self._error(base, name), name), sorted(set(self.candidates) - base))
        ranked = sorted(result for result in self.work.each(fitted) if np.isfinite(result[0]))[:REFITTED]
        finite = self.each(lambda result: self._finite(base | {result[1]}), ranked)
        names = [name for (_, name), is_finite in zip(ranked, finite) if is_finite]
        better = [name for name in names if self._helps(base | {name}, base)]
        if not better:
            return None
        best = min(better, key=lambda name: float(self.fits[base | {name}].heldout.sum()))
        inner = self.candidates[best].contains
        return inner if inner in better and not self._helps(base | {best}, base | {inner}) else best

    def _error(self, base: FrozenSet[str], name: str) -> float:
        """Error of a quick fit to all windows with another effect; infinite where a motion is not finite."""
        first, *also = self.candidates[name].starts(self.fits[base].model)
        try:
            fitted = self.fitter.whole(first, free_parameters(first), also).model
            return float(channel_errors(self.fitter.runs, self.fitter.windows, fitted).sum())
        except Diverged:
            return np.inf

    def _finite(self, names: FrozenSet[str]) -> bool:
        """Whether a set of effects can be cross-validated."""
        try:
            return bool(np.isfinite(self.fit(names).heldout).all())
        except Diverged:
            return False

    def fit(self, names: FrozenSet[str]) -> WindowFit:
        """A set of effects, cross-validated. It starts from the fits of the sets that one effect more or less
        makes and, because a fit without an effect may be far from the right values with it, as given."""
        if names not in self.fits:
            starts: List[_core.Model] = []
            for base, fit in list(self.fits.items()):
                if base < names and len(names - base) == 1:
                    (name,) = names - base
                    starts += self.candidates[name].starts(fit.model)
                    starts.append(self.given)
                    for one in [*sorted(base), name]:
                        starts[-1] = self.candidates[one].add(starts[-1])
                elif names < base and len(base - names) == 1:
                    (name,) = base - names
                    starts.append(fit.model.copy())
                    starts[-1].remove_effect(name)
            first, *also = starts
            self.fits[names] = self.fitter.fit(first, free_parameters(first), also)
        return self.fits[names]

    def chance(self, larger: FrozenSet[str], smaller: FrozenSet[str]) -> float:
        """Probability that the error of held-out data falls as much where an effect does not help."""
        return mean_not_above_zero(self.fit(smaller).by_window - self.fit(larger).by_window)

    def _helps(self, larger: FrozenSet[str], smaller: FrozenSet[str]) -> bool:
        """Whether held-out data show the effect by which two sets differ, for as many as were tried, and it
        matters."""
        if len(self.candidates) * self.chance(larger, smaller) >= LEVEL:
            return False
        a, b = self.fit(larger), self.fit(smaller)
        return self.compared(a, b).is_better and self.matters(b.model, a.model)
