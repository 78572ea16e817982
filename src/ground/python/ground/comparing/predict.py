"""predict: a model's prediction of a run, sample by sample."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, List, Tuple

import numpy as np

from ground import _core
from ground.analysis import horizon as horizons
from ground.analysis.likelihood import call
from ground.data.measured import Part, Recordings, taken
from ground.models import Model, ModelLike
from ground.recordings import headings, quality, windows
from ground.recordings.recording import POSE, PREDICTED, RESIDUAL, SAME_INSTANT, VELOCITY, unit
from ground.reports.words import after, off
from ground.support import command_line
from ground.support.annotations import Array, Document, Indices
from ground.support.errors import GroundError
from ground.support.headline import Line
from ground.support.results import Plotted, Shown, with_units

if TYPE_CHECKING:
    import pandas

COLUMNS = (*POSE, *VELOCITY)


@dataclass(frozen=True, repr=False)
class Prediction(Shown, Plotted):
    """What a model predicts of a run: it starts again and again from what was measured until then, and goes
    on for the horizon by the commands alone. Arrays have a row for each predicted sample and columns x, y
    [m], psi [rad] (world_ned), u, v [m/s], r [rad/s] (body).

    >>> made = ground.predict(model_file, bag, horizon=1.0)
    >>> made.horizon, made.to_frame().attrs["units"]["psi_residual"]
    (1.0, 'rad')
    >>> bool(made.ahead.max() < 1.01 and made.position_mm > made.noise_mm)
    True
    """

    name: str  #: of the run
    model: Model
    horizon: float  #: how far each prediction goes [s]
    position_mm: float  #: rms error of the position at the horizon, over all starts [mm]
    heading_deg: float  #: rms error of the heading there [deg]
    noise_mm: float  #: what the true model would leave, because of the noise of the poses [mm]
    noise_deg: float  #: ... [deg]
    starts: int  #: number of starts that the errors are over
    times: Array  #: (n,) on the run's clock [s]
    start: Indices  #: (n,) number of the start that the sample is predicted from
    ahead: Array  #: (n,) time since that start [s]
    measured: Array  #: (n, 6) poses as measured and repaired, velocities smoothed
    predicted: Array  #: (n, 6)
    zero: float  #: origin of the run's clock, on that of the recording [s]
    run: _core.RunData = field(repr=False)  #: the part of the run that is predicted

    @property
    def residuals(self) -> Array:
        """Measured minus predicted (n, 6), psi within a half turn."""
        left = self.measured - self.predicted
        left[:, 2] = headings.wrap(left[:, 2])
        return left

    @property
    def pieces(self) -> List[Document]:
        """The prediction from each start: times (k,) [s], eta (k, 3) poses, nu (k, 3) velocities."""
        parts = np.split(np.arange(len(self.times)), np.flatnonzero(np.diff(self.start)) + 1)
        return [
            {"times": self.times[at], "eta": self.predicted[at, :3], "nu": self.predicted[at, 3:]}
            for at in parts
        ]

    def to_frame(self) -> "pandas.DataFrame":
        """A row for each sample: t, ahead [s], start, x ... r as measured, x_predicted ..., x_residual ...
        (measured minus predicted); units in attrs["units"]."""
        import pandas

        columns = ["t", "ahead", *(name + end for end in ("", PREDICTED, RESIDUAL) for name in COLUMNS)]
        rows = np.column_stack([self.times, self.ahead, self.measured, self.predicted, self.residuals])
        frame = pandas.DataFrame(rows, columns=columns)
        frame.insert(1, "start", self.start)
        named = {name: unit(name) for name in frame}
        return with_units(frame, {**named, "ahead": "s"})

    def to_dict(self) -> Document:
        """The errors as plain values."""
        names = ("horizon", "position_mm", "heading_deg", "noise_mm", "noise_deg", "starts")
        return {"run": self.name, "model": self.model.label, **{name: getattr(self, name) for name in names}}

    def headline(self, written: str = "") -> List[Line]:
        """Its first lines: how far it is off at the horizon, and what the mocap leaves."""
        found, noise = ({"position_mm": mm, "heading_deg": deg} for mm, deg in (
            (self.position_mm, self.heading_deg), (self.noise_mm, self.noise_deg)
        ))  # fmt: skip
        told = "%s (the mocap alone: %s)" % (off(found), off(noise))
        what = "%s by %s, from %d starts" % (self.name, self.model.label, self.starts)
        return [("Predicted", what), (after({"seconds": self.horizon}), told)]


@command_line.takes(Part)
def predict(model: ModelLike, recording: Recordings, horizon: float = 1.5, *, options: Part) -> Prediction:
    """What a model predicts of a recording, sample by sample, and the error at the horizon.

    recording: a recording or its file. horizon: how far each prediction goes [s]. GroundError when the
    run is too short for it, or there are several runs (compare takes these). Options, as keyword arguments
    or as Part:

    >>> craft = ground.Model.load(model_file)
    >>> made = ground.predict(craft, bag)
    >>> better = craft.with_effect("yaw_bias", n0=2e-5).predict(bag, horizon=1.5)
    >>> better.heading_deg < 0.2 * made.heading_deg  # this craft turns by itself
    True
    >>> made.predicted.shape == made.measured.shape, list(made.to_frame())[:5]
    (True, ['t', 'start', 'ahead', 'x', 'y'])
    """
    found = taken(recording)
    if len(found) != 1:
        raise GroundError("predict takes one run, not %d; compare takes several" % len(found))
    if not 0 < horizon < np.inf:
        raise GroundError("the horizon must be a positive time, not %g s" % horizon)
    given = Model.of(model)
    repaired = quality.repaired(found[0].with_lift_of(given.core))
    return prediction(given, options.of(repaired, given), horizon, repaired.zero)


def prediction(model: Model, run: _core.RunData, seconds: float, zero: float = 0.0) -> Prediction:
    """The Prediction of a _core.RunData; see predict."""
    core, starts = model.core, horizons.starts([run], seconds, horizons.SHOWN)
    errors = horizons.pose_errors([run], horizons.same(core)(starts), starts, seconds)
    error = horizons.PoseError.of(errors)
    least = horizons.PoseError.of(horizons.artificial_errors([run], starts, seconds, core, None))
    tiles, splits = _tiles(run, seconds)
    index = [np.arange(split + 1, tile.last + 1) for tile, split in zip(tiles, splits)]
    at, times = np.concatenate(index), np.array(run.times)
    begun = np.concatenate([np.full(len(own), times[split]) for own, split in zip(index, splits)])
    poses = np.array(run.poses if len(run.poses) else run.eta)
    return Prediction(
        name=run.name,
        model=model,
        horizon=seconds,
        position_mm=error.position_mm,
        heading_deg=error.heading_deg,
        noise_mm=least.position_mm,
        noise_deg=least.heading_deg,
        starts=len(starts),
        times=times[at],
        start=np.repeat(np.arange(1, len(tiles) + 1), [len(own) for own in index]),
        ahead=times[at] - begun,
        measured=np.column_stack([poses, np.array(run.nu)])[at],
        predicted=_simulated(run, model.core, tiles, splits),
        zero=zero,
        run=run,
    )


def _tiles(run: _core.RunData, seconds: float) -> Tuple[List[_core.Window], List[int]]:
    """Windows of horizon.starts whose predicted parts follow each other, and the samples at which these
    begin."""
    times, free = np.array(run.times), -np.inf
    chosen: List[_core.Window] = []
    splits: List[int] = []
    for window in horizons.starts([run], seconds, np.inf):
        split = int(np.searchsorted(times, times[window.first] + horizons.WARM_UP * seconds))
        if times[split] >= free - SAME_INSTANT:
            chosen.append(window)
            splits.append(split)
            free = times[window.last]
    return chosen, splits


def _simulated(run: _core.RunData, model: _core.Model, tiles: List[_core.Window], splits: List[int]) -> Array:
    """Poses and velocities of windows after the samples at which predictions begin, (n, 6). They begin at the
    measured pose, with the velocity that is the best for what was measured before."""
    warm = [_core.Window(0, window.first, split) for window, split in zip(tiles, splits)]
    begun = call(windows.problem([run], warm).simulate, model)["nu"]
    found = call(_core.predict, model, run, tiles, np.array([nu[0] for nu in begun]))
    measured, rows = np.array(run.eta), []
    for eta, nu, window, split in zip(found["eta"], found["nu"], tiles, splits):
        path, start = np.array(eta), split - window.first
        turned = measured[split, 2] - path[start, 2]
        turn = np.array([[np.cos(turned), np.sin(turned)], [-np.sin(turned), np.cos(turned)]])
        place = measured[split, :2] + (path[:, :2] - path[start, :2]) @ turn
        rows.append(np.column_stack([place, path[:, 2] + turned, nu])[start + 1 :])
    return np.vstack(rows)
