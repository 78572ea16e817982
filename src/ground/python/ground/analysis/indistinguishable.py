"""Effects that the runs cannot show, because other parameters of the model can do the same."""

from dataclasses import dataclass
from typing import FrozenSet, Optional, Tuple

import numpy as np

from ground.analysis.likelihood import Fit
from ground.analysis.score_tests import stepped
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
    moved: Tuple[str, ...]  # free parameters that changed to make room for the effect, most first


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
            values = np.array([[model.value(n) for n in fit.free] for model in (fit.model, found.model)])
            ways = np.abs(np.diff(values, axis=0)[0]) / np.maximum(np.abs(values).max(axis=0), 1e-300)
            order = np.argsort(-ways, kind="stable")
            return LookAlike(name, found, tuple(fit.free[i] for i in order if ways[i] > MIN_CHANGE))
    return None
