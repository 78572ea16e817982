"""How sure each effect is by data that decided nothing: parts of the runs, runs that the user held out,
and all of them together."""

from dataclasses import dataclass
from typing import Dict, Optional, Sequence

from ground import _core
from ground.analysis import folds, window_error
from ground.analysis.diagnosis import Diagnosis
from ground.analysis.likelihood import Fit, Likelihood
from ground.recordings import windows


@dataclass(frozen=True)
class Judgement:
    """A model with an effect compared with the same model without it, on data that neither was fitted
    to."""

    fitted: folds.Comparison  # parts of the runs fitted to, each by a fit to the others
    holdout: Optional[folds.Comparison]  # runs that the user held out; None without any
    together: Optional[folds.Comparison]  # parts of all these runs; None where holdout decides


def judgements(found: Diagnosis, heldout: Sequence[_core.RunData]) -> Dict[str, Judgement]:
    """The Judgement of each effect of a grown model, by name."""
    others = _Others(found, heldout) if heldout else None
    result = {}
    for name in sorted(found.names):
        rest = found.search.without(found.names, name)
        fits = found.search.fits[found.names], found.search.fits[rest]
        by_user, together = None, None
        if others:
            by_user = folds.compared(*map(others.tested, fits))
            if by_user.verdict != folds.BETTER:
                together = folds.compared(*map(others.crossed, fits))
        result[name] = Judgement(found.confirmed(found.names, rest), by_user, together)
    return result


class _Others:
    """Runs that the user held out, alone and with those of a diagnosis."""

    def __init__(self, found: Diagnosis, runs: Sequence[_core.RunData]) -> None:
        self.found, self.runs, self.cut = found, runs, windows.cut(runs)
        self.likelihood = Likelihood(runs, found.given, found.likelihood.varying)
        self._folds: Optional[folds.Folds] = None
        self._known: Dict[int, folds.Tested] = {}

    def tested(self, fit: Fit) -> folds.Tested:
        """A Fit on the user's runs."""
        if id(fit) not in self._known:
            self._known[id(fit)] = folds.tested(self.runs, self.cut, self.likelihood, fit)
        return self._known[id(fit)]

    def crossed(self, fit: Fit) -> folds.Tested:
        """A Fit on all runs, each by a fit to the others."""
        if self._folds is None:
            runs, found = [*self.found.runs, *self.runs], self.found
            likelihood = Likelihood(runs, found.given, found.likelihood.varying)
            cut = windows.spread(windows.cut(runs), window_error.MAX_WINDOWS)
            self._folds = folds.Folds(runs, likelihood, found.given, cut, found.each)
        return self._folds.judge(fit).tested
