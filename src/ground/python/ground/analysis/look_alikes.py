"""Effects that the runs cannot show: what they would do, others of the model do as well."""

from dataclasses import dataclass
from typing import FrozenSet, Iterable, List, Optional, Tuple

from ground import _core
from ground.analysis.likelihood import Fit
from ground.analysis.score_tests import UNSEEN, stepped
from ground.analysis.search import Search
from ground.errors import GroundError

SIZES = (1.0, 0.5, 0.25, 0.1, -1.0, -0.5, -0.25, -0.1)  # tried, in parts of the typical size
SETTLED = 0.1  # log-likelihood by which models with and without may differ and do the same
MOVED = 0.05  # relative change from which on a parameter has taken over what the effect does


@dataclass(frozen=True)
class LookAlike:
    """An effect that on the runs does only what others can do."""

    name: str  # the effect's
    fit: Fit  # of the grown model with the effect at some size, all else refitted
    moved: Tuple[str, ...]  # parameters that do without what the effect does in this one


def names(search: Search, chosen: FrozenSet[str], told: Iterable[str]) -> List[str]:
    """Effects, but those told already, that are, to first order, a change of the parameters of the
    model with the chosen ones."""
    tests = search.test_beside(chosen)
    return [n for n in tests.columns if n not in told and tests.seen(n) < UNSEEN]


def look_alike(search: Search, chosen: FrozenSet[str], name: str) -> Optional[LookAlike]:
    """The model grown by the chosen effects with another of typical size, or a part of it, and all
    else refitted, if the runs allow it: a LookAlike; else None."""
    fit = search.fits[chosen]
    neutral = search.candidates[name].neutral(fit.model)
    steps = search.test_beside(chosen).in_place(name, 1.0)
    for part in SIZES:
        try:
            model = stepped(neutral, steps, part)
            found = search.likelihood.fit(model, fit.free, fit, levels=False)
        except GroundError:
            continue
        if found.log_posterior > fit.log_posterior - SETTLED:
            return LookAlike(name, found, _moved(fit, found.model))
    return None


def _moved(fit: Fit, model: _core.Model) -> Tuple[str, ...]:
    """Which of a fit's free parameters differ in another model, most first."""

    def way(name: str) -> float:
        a, b = fit.model.value(name), model.value(name)
        return abs(a - b) / max(abs(a), abs(b)) if a != b else 0.0

    return tuple(sorted((n for n in fit.free if way(n) > MOVED), key=lambda n: -way(n)))
