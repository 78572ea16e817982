"""Quick predictions of the same recordings by many models."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Dict, List, Optional, Tuple

import numpy as np

from ground import _core
from ground.analysis import horizon as horizons
from ground.analysis import missing_wrench, thinning
from ground.analysis.horizon import PoseError
from ground.analysis.residuals import UNITS
from ground.checks import quality
from ground.comparing.predict import Shape
from ground.data.measured import Part
from ground.data.read import Recordings, taken
from ground.models import Model, ModelLike
from ground.reading.recording import COMMAND, POSE, VELOCITY, unit
from ground.support.annotations import Array, Indices
from ground.support.docstrings import Described
from ground.support.errors import GroundError, core_errors
from ground.support.results import with_units

if TYPE_CHECKING:
    import pandas

MOST_SAMPLES = 8000  # of a missing wrench; of a longer run the part asked for, at a lower rate
MOST_PARTS = 16  # parts of runs that are kept cut
SIGMA = "_sigma"  # end of the name of a column


@dataclass(frozen=True)
class PredictedMotion:
    """Measured motion of a run, and predictions from successive starts; rows as in a Prediction."""

    times: Array  #: (n,) times of the samples, on the run's clock [s]
    start: Indices  #: (n,) number of the start that the sample is predicted from
    measured: Array  #: (n, 6) x, y [m], psi [rad], u, v [m/s], r [rad/s]
    predicted: Array  #: (n, 6) in the same columns


class Predictor(Described):
    """Predicts the same recordings with many models, each in hundredths of a second.

    The recordings are read, repaired and cut once. Times are on the run's clock.

    Parameters
    ----------
    model : Model or path
        A model of the craft.
    recordings : Recording, path, or several
        Recordings or bags.
    horizon : float, optional
        How far predictions go [s]; by default chosen for the craft.

    Raises
    ------
    GroundError
        When no run is long enough.

    Examples
    --------
    >>> craft = ground.Model.load(model_file)
    >>> ready = ground.Predictor(craft, bag)
    >>> ready.names, ready.horizon  # [s]
    (['run'], 1.0)
    >>> ready.error(craft.with_effect("yaw_bias", n0=2e-5)).heading_deg < 0.2 * ready.error(craft).heading_deg
    True
    >>> missing = ready.missing(craft)  # the force and moment that the model lacks, along the run
    >>> 1e-5 < missing["N"].mean() < 3e-5  # [N m]
    True
    """

    def __init__(self, model: ModelLike, recordings: Recordings, horizon: Optional[float] = None) -> None:
        """model: of the craft; horizon: how far predictions go [s], by default what suits the craft."""
        self.model = Model.of(model)
        self.recordings = [run.with_lift_of(self.model.core) for run in taken(recordings)]
        self.runs = [Part().of(quality.repaired(run), self.model) for run in self.recordings]
        self.horizon = horizon or horizons.horizon(self.runs, self.model.core)  #: [s]
        self._starts = horizons.Starts.of(self.runs, self.horizon)
        if not len(self._starts.windows):
            raise GroundError("no run is long enough for predictions over %.2g s" % self.horizon)
        self._shapes: Dict[Tuple[int, float, float], Shape] = {}

    @property
    def names(self) -> List[str]:
        """Names of the runs."""
        return [run.name for run in self.recordings]

    def error(self, model: Model) -> PoseError:
        """Errors of the predicted poses at the horizon, over all runs, as in the report of ground.fit."""
        chosen = self._starts.windows
        return PoseError.of(self._starts.errors(self.runs, [model.core] * len(chosen)))

    def noise(self, model: Model) -> PoseError:
        """The noise floor: the error that a true model would have, because of pose noise."""
        return horizons.with_floors(self.runs, self._starts, {}, model.core).mocap

    def motion(self, model: Model, run: str, start: float = 0.0, end: float = np.inf) -> PredictedMotion:
        """Measured and predicted motion of a part of a run.

        Returns
        -------
        PredictedMotion
            Arrays `times`, `start`, `measured` and `predicted`, as in a Prediction.
        """
        key = self._index(run), float(start), float(end)
        if key not in self._shapes:
            if len(self._shapes) > MOST_PARTS:
                self._shapes.clear()
            self._shapes[key] = Shape.of(self._part(run, start, end), self.horizon, self.model.core)
        shape = self._shapes[key]
        return PredictedMotion(shape.times, shape.start, shape.measured, shape.predicted(model.core))

    def measured(self, run: str = "", start: float = 0.0, end: float = np.inf) -> "pandas.DataFrame":
        """Measured motion of a part of a run, with the columns of Recording.to_frame."""
        part = self._part(run, start, end)
        return self._frame(run, np.array(part.times), np.array(part.eta), np.array(part.nu))

    def missing(
        self, model: Model, run: str = "", start: float = 0.0, end: float = np.inf
    ) -> "pandas.DataFrame":
        """The missing force and moment along a part of a run, without collisions.

        Parameters
        ----------
        model : Model
            The model that lacks this force and moment; compare them with its `full_thrust`.

        Returns
        -------
        DataFrame
            The columns of `measured`, and X, Y [N], N [N m] (body) with standard deviations X_sigma ...
        """
        part = thinning.thinned(self._part(run, start, end))
        count = 1 + len(part.times) // MOST_SAMPLES
        if count > 1:
            part = thinning.at_samples(part, slice(0, None, count))
        with core_errors():
            calm = missing_wrench.undisturbed(model.core, part)
            found = missing_wrench.of_wrench(calm, model.core)
        eta, nu = np.array(calm.run.eta), np.array(calm.run.nu)
        frame = self._frame(run, found.times, eta, nu)
        for i, name in enumerate(UNITS):
            frame[name], frame[name + SIGMA] = found.wrench[:, i], found.sigma[:, i]
        return with_units(frame, {name: UNITS.get(name.replace(SIGMA, ""), unit(name)) for name in frame})

    def _frame(self, run: str, times: Array, eta: Array, nu: Array) -> "pandas.DataFrame":
        import pandas

        inputs = quality.repaired(self.recordings[self._index(run)]).inputs(self.model.core)
        held = inputs[np.maximum(0, np.searchsorted(inputs[:, 0], times, side="right") - 1), 1:]
        names = ["t", *POSE, *VELOCITY]
        taken = [*names, *UNITS]
        names += [COMMAND + name if name in taken else name for name in self.model.core.channels]
        frame = pandas.DataFrame(np.column_stack([times, eta, nu, held]), columns=names)
        return with_units(frame, {name: unit(name) for name in names})

    def _index(self, run: str) -> int:
        if run and run not in self.names:
            raise GroundError("there is no run %s" % run)
        return self.names.index(run) if run else 0

    def _part(self, run: str, start: float, end: float) -> _core.RunData:
        whole = self.runs[self._index(run)]
        times = np.array(whole.times)
        at = (times >= start) & (times <= end)
        return whole if at.all() else thinning.at_samples(whole, at)
