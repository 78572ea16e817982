"""predict: a model's prediction of a run, sample by sample."""

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Dict, List, Optional, Sequence, Tuple

import numpy as np

from ground import _core
from ground.analysis import horizon as horizons
from ground.analysis.predicted_band import Course, FitWithout, beyond, half_width
from ground.checks import quality
from ground.data.measured import Part
from ground.data.read import Recordings, taken
from ground.models import Model, ModelLike
from ground.poses import angles
from ground.reading.recording import (
    HIGH,
    LOW,
    POSE,
    PREDICTED,
    RESIDUAL,
    VELOCITY,
    unit,
)
from ground.reports.words import after, least, off
from ground.support import command_line
from ground.support.annotations import Array, Indices
from ground.support.errors import GroundError, warn
from ground.support.headline import Line
from ground.support.results import Plotted, Shown, with_units

if TYPE_CHECKING:
    import pandas

COLUMNS = (*POSE, *VELOCITY)
# What the first velocities of a prediction to the end are fitted to: time [horizons that suit the craft], and
# at least so many intervals between poses.
BEGIN, BEGIN_POSES = 0.1, 5
# Largest overlap of successive parts [horizons] that rounding to samples explains; it is cut off
MOST_BEFORE = 0.1


@dataclass(frozen=True, eq=False, repr=False)
class Prediction(Shown, Plotted):
    """What a model predicts of a run: it restarts repeatedly from past measurements, and goes
    on for the horizon by the commands alone. Arrays have a row for each predicted sample and columns x, y
    [m], psi [rad] (world_ned), u, v [m/s], r [rad/s] (body).

    >>> made = ground.predict(model_file, bag, horizon=1.0)
    >>> made.horizon, made.to_frame().attrs["units"]["psi_residual"]
    (1.0, 'rad')
    >>> bool(made.ahead.max() < 1.01 and made.position_mm > made.noise_mm)
    True
    """

    name: str  #: name of the run
    model: Model  #: the predicting model
    horizon: float  #: how far each prediction goes [s]; of a prediction to the end, the longest
    position_mm: float  #: rms error of the position at the horizon, over all starts [mm]
    heading_deg: float  #: rms error of the heading at the horizon, over all starts [deg]
    noise_mm: float  #: noise floor: rms error of the position with a true model, from pose noise [mm]
    noise_deg: float  #: noise floor of the heading [deg]
    starts: int  #: number of starts over which the errors are taken
    times: Array  #: (n,) times of the samples, on the run's clock [s]
    start: Indices  #: (n,) number of the start that the sample is predicted from
    ahead: Array  #: (n,) time since the start of the prediction [s]
    measured: Array  #: (n, 6) poses as measured and repaired, velocities smoothed
    predicted: Array  #: (n, 6) predicted poses and velocities
    zero: float  #: origin of the run's clock, on the recording's clock [s]
    run: _core.RunData = field(repr=False)  #: the part of the run that is predicted
    band: Optional[float] = None  #: intended share of samples in the band; None: no band
    low: Optional[Array] = None  #: (n, 6) lower end of the band
    high: Optional[Array] = None  #: (n, 6) upper end of the band

    @property
    def residuals(self) -> Array:
        """Measured minus predicted (n, 6), psi within half a turn."""
        left = self.measured - self.predicted
        left[:, 2] = angles.wrap(left[:, 2])
        return left

    @property
    def held(self) -> Optional[Array]:
        """Share of the samples that lie in the band, (6,); None without a band."""
        if self.low is None or self.high is None:
            return None
        return np.asarray((np.abs(self.residuals) <= (self.high - self.low) / 2).mean(axis=0))

    @property
    def pieces(self) -> List[Dict[str, Array]]:
        """The prediction from each start: times (k,) [s], eta (k, 3) poses, nu (k, 3) velocities."""
        parts = np.split(np.arange(len(self.times)), np.flatnonzero(np.diff(self.start)) + 1)
        return [
            {"times": self.times[at], "eta": self.predicted[at, :3], "nu": self.predicted[at, 3:]}
            for at in parts
        ]

    def to_frame(self) -> "pandas.DataFrame":
        """A row for each sample: t, ahead [s], start, x ... r as measured, x_predicted ..., x_residual ...
        (measured minus predicted), with a band x_low ... and x_high ...; units in attrs["units"]."""
        import pandas

        parts = {"": self.measured, PREDICTED: self.predicted, RESIDUAL: self.residuals}
        if self.low is not None and self.high is not None:
            parts.update({LOW: self.low, HIGH: self.high})
        columns = ["t", "ahead", *(name + end for end in parts for name in COLUMNS)]
        rows = np.column_stack([self.times, self.ahead, *parts.values()])
        frame = pandas.DataFrame(rows, columns=columns)
        frame.insert(1, "start", self.start)
        named = {name: unit(name) for name in frame}
        return with_units(frame, {**named, "ahead": "s"})

    def to_dict(self) -> Dict[str, object]:
        """The errors as plain values, with run, model and horizon."""
        names = ("horizon", "position_mm", "heading_deg", "noise_mm", "noise_deg", "starts")
        told: Dict[str, object] = {"run": self.name, "model": self.model.label}
        told.update((name, getattr(self, name)) for name in names)
        if self.held is not None:
            told.update(band=self.band, held=dict(zip(COLUMNS, self.held.tolist())))
        return told

    def headline(self, written: str = "") -> List[Line]:
        """First lines of the report: the error at the horizon, and the noise floor."""
        noise = horizons.PoseError(self.noise_mm, self.noise_deg)
        found = horizons.PoseError(self.position_mm, self.heading_deg)
        told = "%s (%s)" % (off(found), least(found, noise))
        what = "%s by %s, from %d starts" % (self.name, self.model.label, self.starts)
        lines = [("Predicted", what), (after(self.horizon), told)]
        if self.held is not None and self.band is not None:
            shares = ", ".join("%.0f%% of %s" % (100 * part, name) for part, name in zip(self.held, POSE))
            lines.append(("Band of %.0f%%" % (100 * self.band), "contains " + shares))
        return lines


@command_line.takes(Part)
def predict(
    model: ModelLike,
    recording: Recordings,
    horizon: Optional[float] = None,
    band: Optional[float] = None,
    parts: Sequence[FitWithout] = (),
    *,
    options: Part,
) -> Prediction:
    """Predicts a recording with a model, sample by sample, with the error at the horizon.

    Parameters
    ----------
    horizon : float, optional
        How far each prediction goes [s]; by default chosen for the craft, as in `compare`. Infinity
        predicts from the beginning to the end, or to the next gap.
    band : float, optional
        Share of the samples that a band should contain, 0..1. A band needs `parts`.
    parts : sequence, optional
        Fits that leave out a part of the runs; `Fit.predict` passes them.

    Raises
    ------
    GroundError
        When the run is too short, or there are several runs (`compare` accepts several).

    Warns
    -----
    GroundWarning
        When the run goes beyond the runs from which the band was derived.

    Examples
    --------
    >>> craft = ground.Model.load(model_file)
    >>> made = ground.predict(craft, bag)
    >>> better = craft.with_effect("yaw_bias", n0=2e-5).predict(bag, horizon=1.0)
    >>> better.heading_deg < 0.2 * made.heading_deg  # this craft turns by itself
    True
    >>> made.predicted.shape == made.measured.shape, list(made.to_frame())[:5]
    (True, ['t', 'start', 'ahead', 'x', 'y'])
    """
    found = taken(recording)
    if len(found) != 1:
        raise GroundError("predict accepts a single run, not %d; compare accepts several" % len(found))
    if horizon is not None and not horizon > 0:
        raise GroundError("the horizon must be a positive time, not %g s" % horizon)
    given = Model.of(model)
    repaired = quality.repaired(found[0].with_lift_of(given.core))
    data = options.of(repaired, given)
    seconds = horizon or horizons.horizon([data], given.core)
    made = prediction(given, data, seconds, repaired.zero)
    if band is None:
        return made

    def course(run: _core.RunData, model: _core.Model) -> Optional[Course]:
        try:
            shape = Shape.of(run, seconds, given.core)
        except GroundError:  # too short
            return None
        return shape.predicted(model), shape.measured

    half = half_width(parts, band, course, made.run)
    further = beyond(parts, made.predicted)
    if further:
        warn(
            "%s: the run goes beyond the runs that the model was fitted to, in %s: the band may be too narrow"
            % (made.name, " and ".join(VELOCITY[i] for i in further))
        )
    return replace(made, band=band, low=made.predicted - half, high=made.predicted + half)


def prediction(model: Model, run: _core.RunData, seconds: float, zero: float = 0.0) -> Prediction:
    """The Prediction of a _core.RunData; see predict."""
    shape = Shape.of(run, seconds, model.core)
    predicted, ahead = shape.predicted(model.core), shape.ahead
    whole = not np.isfinite(seconds)
    seconds = float(ahead.max()) if whole else seconds
    if whole:
        error, least = shape.end_error(predicted), horizons.PoseError(*horizons.pose_noise([run]).tolist())
        count = len(shape.tiles)
    else:
        starts = horizons.Starts(horizons.starts([run], seconds), seconds)
        count = len(starts.windows)
        error = horizons.PoseError.of(starts.errors([run], [model.core] * count))
        least = horizons.with_floors([run], starts, {}, model.core).mocap
    return Prediction(
        name=run.name,
        model=model,
        horizon=seconds,
        position_mm=error.position_mm,
        heading_deg=error.heading_deg,
        noise_mm=least.position_mm,
        noise_deg=least.heading_deg,
        starts=count,
        times=shape.times,
        start=shape.start,
        ahead=ahead,
        measured=shape.measured,
        predicted=predicted,
        zero=zero,
        run=run,
    )


@dataclass(frozen=True)
class Shape:
    """Parts of a run that are predicted, one after the other."""

    run: _core.RunData
    tiles: List[_core.Window]
    splits: List[int]  # the samples at which the predicted parts of the tiles begin

    @classmethod
    def of(cls, run: _core.RunData, seconds: float, model: _core.Model) -> "Shape":
        """Stretches of some seconds, or whole ones if seconds are infinite; GroundError without any."""
        if np.isfinite(seconds):
            return cls(run, *_tiles(run, seconds))
        return cls(run, *_stretches(run, horizons.horizon([run], model)))

    def predicted(self, model: _core.Model) -> Array:
        """Poses and velocities (n, 6) by a model."""
        warm = [_core.Window(0, tile.first, split) for tile, split in zip(self.tiles, self.splits)]
        made = horizons.predicted(self.run, model, warm, [tile.last for tile in self.tiles])
        return np.vstack([path[1:] for path in made])

    @property
    def _index(self) -> List[Indices]:
        return [np.arange(split + 1, tile.last + 1) for tile, split in zip(self.tiles, self.splits)]

    @property
    def _rows(self) -> Indices:
        return np.concatenate(self._index)

    @property
    def times(self) -> Array:
        """(n,) on the run's clock [s]."""
        return np.asarray(self.run.times)[self._rows]

    @property
    def start(self) -> Indices:
        """(n,) number of the tile."""
        return np.repeat(np.arange(1, len(self.tiles) + 1), [len(own) for own in self._index])

    @property
    def ahead(self) -> Array:
        """(n,) time since the beginning of the tile's predicted part [s]."""
        return np.asarray(self.times - np.asarray(self.run.times)[self.splits][self.start - 1])

    @property
    def measured(self) -> Array:
        """(n, 6) poses as measured, velocities smoothed."""
        poses = np.array(self.run.poses if len(self.run.poses) else self.run.eta)
        return np.asarray(np.column_stack([poses, np.array(self.run.nu)])[self._rows])

    def end_error(self, predicted: Array) -> horizons.PoseError:
        """The error at the ends of the tiles."""
        ends = np.cumsum([len(own) for own in self._index]) - 1
        return horizons.PoseError.of(horizons.apart(predicted[ends, :3], self.measured[ends, :3]))


def _stretches(run: _core.RunData, least: float) -> Tuple[List[_core.Window], List[int]]:
    """Stretches without a gap, longer than a time [s]; the samples at which predictions begin."""
    times = np.array(run.times)
    ends = [*np.flatnonzero(np.diff(times) > run.scales.max_gap).tolist(), len(times) - 1]
    tiles: List[_core.Window] = []
    first = 0
    for end in ends:
        if times[end] - times[first] > least and end - first > BEGIN_POSES:
            tiles.append(_core.Window(0, first, end))
        first = end + 1
    if not tiles:
        raise GroundError("%s: no stretch without a gap is longer than %.2g s" % (run.name, least))
    begins = np.searchsorted(times, times[[tile.first for tile in tiles]] + BEGIN * least)
    return tiles, [max(int(begin), tile.first + BEGIN_POSES) for begin, tile in zip(begins, tiles)]


def _tiles(run: _core.RunData, seconds: float) -> Tuple[List[_core.Window], List[int]]:
    """Windows of horizon.starts whose predicted parts follow each other, and the samples at which these
    begin."""
    times, free = np.array(run.times), -np.inf
    chosen: List[_core.Window] = []
    splits: List[int] = []
    for window in horizons.starts([run], seconds, np.inf):
        split = int(np.searchsorted(times, times[window.first] + horizons.WARM_UP * seconds))
        begin = max(split, chosen[-1].last) if chosen else split
        if times[split] >= free - MOST_BEFORE * seconds and begin < window.last:
            splits.append(begin)
            chosen.append(window)
            free = times[window.last]
    return chosen, splits
