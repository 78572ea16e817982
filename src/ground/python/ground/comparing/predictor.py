"""Quick predictions of the same recordings by many models."""

from dataclasses import dataclass
from typing import Dict, List, Optional, Tuple

import numpy as np

from ground import _core
from ground.analysis import horizon as horizons
from ground.analysis import missing_wrench, thinning
from ground.analysis.horizon import PoseError
from ground.analysis.missing_wrench import Missing
from ground.analysis.window_error import FEW_WINDOWS
from ground.comparing.predict import Shape
from ground.data.measured import Part, Recordings, taken
from ground.models import Model, ModelLike
from ground.recordings import quality, windows
from ground.support.annotations import Array, Indices
from ground.support.errors import GroundError, core_errors

MOST_SAMPLES = 8000  # of a missing wrench; of a longer run the part asked for, at a lower rate
MOST_PARTS = 16  # parts of runs that are kept cut


@dataclass(frozen=True)
class Motion:
    """What is measured of a run, and predicted from start after start; rows as a Prediction has them."""

    times: Array  #: (n,) on the run's clock [s]
    start: Indices  #: (n,) number of the start that the sample is predicted from
    measured: Array  #: (n, 6) x, y [m], psi [rad], u, v [m/s], r [rad/s]
    predicted: Array  #: (n, 6)


class Predictor:
    """Recordings that are read, repaired and cut once, so that a prediction by another model of the craft
    takes hundredths of a second.

    >>> craft = ground.Model.load(model_file)
    >>> ready = ground.Predictor(craft, bag)
    >>> ready.names, ready.horizon  # [s]
    (['run'], 1.0)
    >>> ready.error(craft.with_effect("yaw_bias", n0=2e-5)).heading_deg < 0.2 * ready.error(craft).heading_deg
    True
    """

    def __init__(self, model: ModelLike, recordings: Recordings, horizon: Optional[float] = None) -> None:
        """model: of the craft; horizon: how far predictions go [s], by default what suits the craft."""
        self.model = Model.of(model)
        self.recordings = [run.with_lift_of(self.model.core) for run in taken(recordings)]
        self.runs = [Part().of(quality.repaired(run), self.model) for run in self.recordings]
        self.horizon = horizon or horizons.horizon(self.runs, self.model.core)  #: [s]
        found = horizons.Starts.of(self.runs, self.horizon)
        if not len(found.windows):
            raise GroundError("no run is long enough for predictions over %.2g s" % self.horizon)
        self._shapes: Dict[Tuple[int, float, float], Shape] = {}
        self._starts = horizons.Starts(windows.spread(list(found.windows), FEW_WINDOWS), self.horizon)

    @property
    def names(self) -> List[str]:
        """Names of the runs."""
        return [run.name for run in self.recordings]

    def error(self, model: Model) -> PoseError:
        """How far the predicted poses are off at the horizon, over all runs; as `ground.fit` says it."""
        chosen = self._starts.windows
        return PoseError.of(self._starts.errors(self.runs, [model.core] * len(chosen)))

    def noise(self, model: Model) -> PoseError:
        """What of that the noise of the poses alone would leave if the model were true."""
        with core_errors():
            errors = horizons.artificial_errors(
                self.runs, self._starts.windows, self.horizon, model.core, None
            )
        return PoseError.of(errors)

    def motion(self, model: Model, run: str, start: float = 0.0, end: float = np.inf) -> Motion:
        """What is measured and predicted of a part of a run, on the run's clock [s]."""
        key = self.names.index(run), float(start), float(end)
        if key not in self._shapes:
            if len(self._shapes) > MOST_PARTS:
                self._shapes.clear()
            self._shapes[key] = Shape.of(self._part(run, start, end), self.horizon, self.model.core)
        shape = self._shapes[key]
        return Motion(shape.times, shape.start, shape.measured, shape.predicted(model.core))

    def missing(self, model: Model, run: str, start: float = 0.0, end: float = np.inf) -> Missing:
        """The force and moment that the model misses along a part of a run."""
        part = thinning.thinned(self._part(run, start, end))
        count = 1 + len(part.times) // MOST_SAMPLES
        if count > 1:
            part = thinning.at_samples(part, slice(0, None, count))
        with core_errors():
            calm = missing_wrench.undisturbed(model.core, part)
            return missing_wrench.of_wrench(calm, model.core)

    def _part(self, run: str, start: float, end: float) -> _core.RunData:
        whole = self.runs[self.names.index(run)]
        times = np.array(whole.times)
        at = (times >= start) & (times <= end)
        return whole if at.all() else thinning.at_samples(whole, at)
