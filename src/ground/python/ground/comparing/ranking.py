"""Models by their error, and which of them chance alone may set apart."""

from dataclasses import dataclass
from typing import Dict, List, Mapping, Sequence

import numpy as np

from ground.analysis.distributions import mean_not_above_zero, pieces_of
from ground.support.annotations import Array, Indices

CHANCE = 0.05  # probability that any of equally good models is reported to differ from the best


@dataclass(frozen=True)
class Ranking:
    """Models by their error, the smallest first. The ranking tells which one predicts best only where no
    model was fitted to the runs."""

    role: str  #: "held_out": no model was fitted to the runs; "fit": one was
    runs: List[str]  #: runs that no model was fitted to; without such runs, all
    errors: Dict[str, float]  #: errors by label, over these runs
    fitted: List[str]  #: labels of models that were fitted to any of these runs
    #: labels of models whose errors differ from the smallest one by no more than chance explains
    equal: List[str]

    @property
    def best(self) -> str:
        """Label of the model with the smallest error."""
        return next(iter(self.errors))


def equally_good(order: Sequence[str], by_window: Mapping[str, Array], run_of: Indices) -> List[str]:
    """Models that are not significantly worse than the first one. order: labels, the least error first;
    by_window: errors (n,) in windows; run_of: (n,) their runs. The first one was chosen on them, so that any
    pair may be compared, either way round, and all share the level (Bonferroni)."""
    pieces = pieces_of(run_of)
    best, *others = ((label, np.array([by_window[label][p].mean() for p in pieces])) for label in order)
    level = CHANCE / max(1, len(order) * len(others))
    return [label for label, errors in others if mean_not_above_zero(errors - best[1]) > level]
