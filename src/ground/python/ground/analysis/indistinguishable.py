"""Effects that the runs cannot show, because other parameters of the model can do the same."""

from dataclasses import dataclass
from typing import FrozenSet, Iterable, List, Optional, Tuple

from ground import _core
from ground.analysis.likelihood import Fit
from ground.analysis.score_tests import UNSEEN, stepped
from ground.analysis.search import Search
from ground.support.errors import GroundError

SIZES = (1.0, 0.5, 0.25, 0.1, -1.0, -0.5, -0.25, -0.1)  # tried sizes, relative to the typical one
MAX_LOSS = 0.1  # loss of log-likelihood up to which two models do the same
MIN_CHANGE = 0.05  # relative change of a parameter that has made room for the effect


@dataclass(frozen=True)
class LookAlike:
    """An effect that on the runs does only what other parameters can do."""

    name: str  # the effect's
    fit: Fit  # the grown model with the effect at some size, all else refitted
    moved: Tuple[str, ...]  # parameters that changed to make room for the effect


def names(search: Search, chosen: FrozenSet[str], known: Iterable[str]) -> List[str]:
    """Effects, except the known ones, that to first order equal a change of the parameters of the
    model with the chosen effects."""
    tests = search.test_beside(chosen)
    return [n for n in tests.columns if n not in known and tests.seen(n) < UNSEEN]


def look_alike(search: Search, chosen: FrozenSet[str], name: str) -> Optional[LookAlike]:
    """Adds an effect of typical size, or a part of it, to the model with the chosen effects, and
    refits all else: a LookAlike if the likelihood stays the same, else None."""
    fit = search.fits[chosen]
    neutral = search.candidates[name].neutral(fit.model)
    steps = search.test_beside(chosen).in_place(name, 1.0)
    for part in SIZES:
        try:
            model = stepped(neutral, steps, part)
            found = search.likelihood.fit(model, fit.free, fit, levels=False)
        except GroundError:
            continue
        if found.log_posterior > fit.log_posterior - MAX_LOSS:
            return LookAlike(name, found, _moved(fit, found.model))
    return None


def _moved(fit: Fit, model: _core.Model) -> Tuple[str, ...]:
    """Which of a fit's free parameters differ in another model, most first."""

    def way(name: str) -> float:
        a, b = fit.model.value(name), model.value(name)
        return abs(a - b) / max(abs(a), abs(b)) if a != b else 0.0

    return tuple(sorted((n for n in fit.free if way(n) > MIN_CHANGE), key=lambda n: -way(n)))
