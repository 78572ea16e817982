"""What the page of a diagnosis draws: runs, models and prediction bands."""

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING, Dict, List, Sequence, Tuple

from ground import _core
from ground.analysis.bands import Bands
from ground.support.annotations import Document
from ground.support.errors import Diverged, warn

if TYPE_CHECKING:
    from ground.reports.inspection import Inspection

REFITTED = "refitted"  # label of the nominal model


@dataclass(frozen=True)
class Drawn:
    """What is drawn; it can be pickled."""

    runs: Sequence[_core.RunData]  #: runs fitted to
    held: Sequence[_core.RunData]  #: runs that were held out
    #: by label: the nominal one, refitted, and, with effects, the "improved" one
    models: Dict[str, _core.Model]
    likeliest: _core.Model  #: the nominal one, refitted by likelihood
    bands: List[Bands]  #: prediction bands of the improved model
    described: List[Document]  #: findings.describe of all runs
    inputs: List[str]  #: paths of all that was read

    def inspected(self, chosen: Sequence[int]) -> "List[List[Inspection]]":
        """For runs by their numbers, first those fitted to, the Inspection of each model; none, with a
        warning, where a motion is not finite."""
        from ground.reports import inspection
        from ground.support.workers import Workers

        runs = [(run, "fit") for run in self.runs] + [(run, "held_out") for run in self.held]

        def inspect(task: Tuple[int, Tuple[str, _core.Model]]) -> "Inspection":
            number, (label, model) = task
            run, role = runs[number]
            return inspection.inspect(run, model, label, role)

        # a refit by simulation error, over windows, may diverge along whole runs
        for models in (self.models, {**self.models, REFITTED: self.likeliest}):
            try:
                each = iter(list(Workers().map(inspect, itertools.product(chosen, models.items()))))
            except Diverged as error:
                failure = error
            else:
                return [[next(each) for _ in models] for _ in chosen]
        warn("no run is drawn: %s" % failure)
        return []
