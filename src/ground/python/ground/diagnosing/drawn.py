"""What the page of a diagnosis draws: runs, models and prediction bands."""

import itertools
from dataclasses import dataclass
from typing import Dict, List, Sequence, Tuple

from ground import _core
from ground.analysis.bands import Bands
from ground.reports import inspection
from ground.support.annotations import Document
from ground.support.errors import GroundError, warn
from ground.support.workers import Workers

NOMINAL, IMPROVED = "refitted", "improved"  # labels of models
MAX_DRAWN = 8  # runs that are drawn; to infer the missing wrench along each takes seconds


@dataclass(frozen=True)
class Drawn:
    """What is drawn; it can be pickled."""

    runs: Sequence[_core.RunData]  #: runs fitted to
    held: Sequence[_core.RunData]  #: runs that were held out
    models: Dict[
        str, _core.Model
    ]  #: by label: the nominal one, refitted, and, with effects, the improved one
    likeliest: _core.Model  #: the nominal one, refitted by likelihood
    bands: List[Bands]  #: prediction bands of the improved model
    described: List[Document]  #: findings.describe of all runs
    inputs: List[str]  #: paths of all that was read

    @property
    def chosen(self) -> List[int]:
        """Numbers of the runs that are drawn, of those fitted to and then those held out."""
        count = len(self.runs) + len(self.held)
        most = min(MAX_DRAWN, count)
        return [i * count // most for i in range(most)]

    @property
    def banded(self) -> Dict[int, Bands]:
        """The bands by the id of their run."""
        return {id(band.run): band for band in self.bands}

    def inspected(self, chosen: Sequence[int]) -> List[List[Document]]:
        """For runs by their numbers, the results of ground.reports.inspection for each model; none, with a
        warning, where a motion is not finite."""
        # a refit by simulation error, over windows, may diverge along whole runs
        for models in (self.models, {**self.models, NOMINAL: self.likeliest}):
            try:
                return self._inspected(chosen, models)
            except GroundError as error:
                failure = error
        warn("no run is drawn: %s" % failure)
        return []

    def _inspected(self, chosen: Sequence[int], models: Dict[str, _core.Model]) -> List[List[Document]]:
        runs = [(run, "fit") for run in self.runs] + [(run, "held_out") for run in self.held]

        def inspect(task: Tuple[int, Tuple[str, _core.Model]]) -> Document:
            number, (label, model) = task
            run, role = runs[number]
            return inspection.inspect(run, model, label, role)

        each = iter(list(Workers().map(inspect, itertools.product(chosen, models.items()))))
        return [[next(each) for _ in models] for _ in chosen]
