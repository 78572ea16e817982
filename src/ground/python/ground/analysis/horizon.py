"""Predicted poses at the horizon that suits a craft: the size of an error, or of an effect, as a
person sees it."""

import contextlib
import math
from dataclasses import asdict, dataclass, field
from typing import Callable, Dict, List, Mapping, Optional, Sequence, Tuple

import numpy as np

from ground import _core
from ground.analysis import window_error, windows
from ground.analysis.likelihood import call
from ground.poses import angles
from ground.poses.repair import MIN_POSES
from ground.support.annotations import Array, Indices
from ground.support.errors import Diverged, GroundError
from ground.support.records import NULL

WARM_UP = 0.5  # time before a start that its initial velocities are fitted to [horizons]

INFINITE = {NULL: math.inf}
ModelsAt = Callable[[Sequence[_core.Window]], Sequence[_core.Model]]  # a model for each of some windows


def same(model: _core.Model) -> ModelsAt:
    """The same model for all windows."""
    return lambda chosen: [model] * len(chosen)


def horizon(runs: Sequence[_core.RunData], model: _core.Model) -> float:
    """Time [s] in which full thrust moves a craft by some lengths or turns it round: 1 s for a
    palm-sized hovercraft, 10 s for a free-flyer. Long enough for some poses, and short enough for a start in
    each part that may be held out. Diagnoses use the horizon of the given model for all models."""
    least = MIN_POSES * float(np.median(np.concatenate([np.diff(np.array(run.times)) for run in runs])))
    seconds = _core.time_scale(model)
    while seconds > least:
        if sum(len(_starts_in(run, i, seconds)) for i, run in enumerate(runs)) >= window_error.PARTS:
            return seconds
        seconds = _core.rounded_time(0.45 * seconds)
    return least


def starts(
    runs: Sequence[_core.RunData], seconds: float, most: float = window_error.MAX_WINDOWS
) -> List[_core.Window]:
    """Stretches of runs (_core.RunData) that end a horizon of some seconds after a start. They begin
    where the fit of the initial state does, and overlap. GroundError when no run is long enough."""
    found = [w for i, run in enumerate(runs) for w in _starts_in(run, i, seconds)]
    if not found:
        raise GroundError("no run is long enough for predictions over %.2g s" % seconds)
    return windows.spread(found, most)


@dataclass(frozen=True)
class Starts:
    """Predictions of runs over a time; none where the runs are too short."""

    windows: Sequence[_core.Window]  # as starts() has them
    seconds: float

    @classmethod
    def of(cls, runs: Sequence[_core.RunData], seconds: float) -> "Starts":
        """Starts of runs over some seconds."""
        try:
            return cls(starts(runs, seconds), seconds)
        except GroundError:
            return cls((), seconds)

    @property
    def of_run(self) -> Indices:
        """The run (n,) of each."""
        return np.array([window.run for window in self.windows])

    def errors(self, runs: Sequence[_core.RunData], models: Sequence[_core.Model]) -> Array:
        """pose_errors (n, 2) of models, one for each; infinite for a run in which a motion is not finite."""
        found = np.full((len(self.windows), 2), np.inf)
        for i in np.unique(self.of_run):
            at = np.flatnonzero(self.of_run == i).tolist()
            own = [self.windows[k] for k in at]
            with contextlib.suppress(Diverged):
                found[at] = pose_errors(runs, [models[k] for k in at], own, self.seconds)
        return found


def _starts_in(run: _core.RunData, index: int, seconds: float) -> List[_core.Window]:
    length, shift = (1 + WARM_UP) * seconds, WARM_UP * seconds
    times = np.array(run.times)
    gaps = np.flatnonzero(np.diff(times) > run.scales.max_gap)
    cut: List[_core.Window] = []
    # each stretch by itself: behind a gap, all windows would begin together
    for start, end in zip(times[[0, *(gaps + 1)]], times[[*gaps, -1]]):
        for i in range(round(length / shift)):
            cut += windows.cut_part(run, index, start + i * shift, end, length)
    return sorted(cut, key=lambda w: int(w.first))


def predicted_poses(
    runs: Sequence[_core.RunData], model: _core.Model, chosen: Sequence[_core.Window], seconds: float
) -> Array:
    """Poses x, y [m], psi [rad] that a model predicts at the ends of starts(), (n, 3). It is simulated from
    the beginning of each, with the velocities that are the best for what was measured before the start.
    GroundError when a motion is not finite."""
    ends = np.empty((len(chosen), 3))
    for i, run in enumerate(runs):
        at = [k for k, window in enumerate(chosen) if window.run == i]
        if at:
            own = [_core.Window(0, chosen[k].first, chosen[k].last) for k in at]
            begun = call(windows.problem([run], warm_ups(run, own, seconds)).simulate, model)["nu"]
            ended = call(_core.predict, model, run, own, np.array([nu[0] for nu in begun]))["eta"]
            ends[at] = [eta[-1] for eta in ended]
    return ends


def warm_ups(run: _core.RunData, chosen: Sequence[_core.Window], seconds: float) -> List[_core.Window]:
    """What was measured before the start of each of starts() of a run, whose last sample is the start."""
    begins = np.array(run.times)[[window.first for window in chosen]] + WARM_UP * seconds
    splits = np.searchsorted(run.times, begins)
    return [_core.Window(0, window.first, int(split)) for window, split in zip(chosen, splits)]


def pose_errors(
    runs: Sequence[_core.RunData],
    models: Sequence[_core.Model],
    chosen: Sequence[_core.Window],
    seconds: float,
) -> Array:
    """Errors of position [mm] and heading [deg] of the poses that models, one for each of starts(), predict
    at their ends, (n, 2): see predicted. GroundError when a motion is not finite."""
    ends, measured = np.empty((len(chosen), 3)), np.empty((len(chosen), 3))
    groups: Dict[Tuple[int, int], List[int]] = {}
    for k, (window, model) in enumerate(zip(chosen, models)):
        groups.setdefault((window.run, id(model)), []).append(k)
    for (i, _), at in groups.items():
        run, lasts = runs[i], [chosen[k].last for k in at]
        warm = warm_ups(run, [chosen[k] for k in at], seconds)
        ends[at] = [path[-1, :3] for path in predicted(run, models[at[0]], warm, lasts)]
        measured[at] = np.array(run.poses if len(run.poses) else run.eta)[lasts]
    return apart(ends, measured)


def predicted(
    run: _core.RunData, model: _core.Model, warm: Sequence[_core.Window], lasts: Sequence[int]
) -> List[Array]:
    """Poses and velocities (k, 6) that a model predicts from each start to a last sample, both included.
    warm: what was measured before, whose last sample is the start. Predictions begin at the measured pose.
    Their first velocities are the model's, moved by what it misses of the measured ones: by a line through
    the difference in the time before, so that a missing force does not delay them. GroundError when a motion
    is not finite."""
    before = call(windows.problem([run], warm).simulate, model)["nu"]
    begun = np.array([_velocities(run, *pair) for pair in zip(warm, before)])
    own = [_core.Window(0, w.last, last) for w, last in zip(warm, lasts)]
    found = call(_core.predict, model, run, own, begun)
    return [np.column_stack(pair) for pair in zip(found["eta"], found["nu"])]


def _velocities(run: _core.RunData, warm: _core.Window, simulated: Array) -> Array:
    """Velocities u, v [m/s], r [rad/s] at the end of a warm-up."""
    span = slice(warm.first, warm.last + 1)
    times = np.array(run.times)[span] - run.times[warm.last]
    missed = np.polyfit(times, np.array(run.nu)[span] - simulated, 1)
    return np.asarray(simulated[-1] + missed[1])


@dataclass(frozen=True)
class PoseError:
    """How far predicted poses are off: root mean square over starts. Infinite where a motion is not
    finite."""

    position_mm: float = field(metadata=INFINITE)
    heading_deg: float = field(metadata=INFINITE)

    @classmethod
    def of(cls, errors: Array) -> "PoseError":
        """From the errors of pose_errors."""
        return cls(*np.sqrt((errors**2).mean(axis=0)).tolist())


@dataclass(frozen=True)
class PredictionError:
    """How far the poses that models predict are off after some time, on data that they were not fitted to."""

    seconds: float  #: time over which poses are predicted [s]
    errors: Dict[str, PoseError]  #: errors by model
    mocap: PoseError  #: noise floor: errors of a true model, from pose noise
    disturbed: Optional[PoseError] = None  #: the same under the random disturbance; None: not known


def as_document(found: Optional[PredictionError]) -> Optional[Dict[str, object]]:
    """A PredictionError as a dictionary."""
    return None if found is None else asdict(found)


def prediction_error(
    runs: Sequence[_core.RunData],
    seconds: float,
    models: Mapping[str, ModelsAt],
    truth: _core.Model,
    levels: Optional[Mapping[str, float]] = None,
) -> Optional[PredictionError]:
    """The PredictionError of models by name, over starts() of runs; None where runs are too short. truth,
    levels: see with_floors."""
    at = Starts.of(runs, seconds)
    if not len(at.windows):
        return None
    errors = {name: PoseError.of(at.errors(runs, own(at.windows))) for name, own in models.items()}
    return with_floors(runs, at, errors, truth, levels)


def with_floors(
    runs: Sequence[_core.RunData],
    at: Starts,
    errors: Mapping[str, PoseError],
    truth: _core.Model,
    levels: Optional[Mapping[str, float]] = None,
) -> PredictionError:
    """The PredictionError of known errors of models by name. truth: the model that makes the artificial
    recordings which show what noise leaves; levels: of the disturbance of a likelihood, if they are known."""
    chosen = windows.spread(list(at.windows), window_error.FEW_WINDOWS)

    def floor_of(pushed: Optional[Mapping[str, float]]) -> PoseError:
        try:
            return PoseError.of(artificial_errors(runs, chosen, at.seconds, truth, pushed))
        except Diverged:
            return PoseError(np.inf, np.inf)

    return PredictionError(at.seconds, dict(errors), floor_of(None), floor_of(levels) if levels else None)


def artificial_errors(
    runs: Sequence[_core.RunData],
    chosen: Sequence[_core.Window],
    seconds: float,
    model: _core.Model,
    levels: Optional[Mapping[str, float]],
) -> Array:
    """pose_errors of a model on four recordings of each run that it made, with noise and a disturbance of
    some levels."""
    errors = []
    for seed in range(4):
        made = []
        for i, run in enumerate(runs):
            random = np.random.default_rng((seed, i))
            wrench, room = window_error.pushes(run, levels, random) if levels else (None, None)
            made.append(window_error.recorded(run, model, random, wrench, room=room))
        errors.append(pose_errors(made, [model] * len(chosen), chosen, seconds))
    return np.concatenate(errors)


@dataclass(frozen=True)
class PredictionChange:
    """Distance between the poses that two models predict at a horizon, rms over starts."""

    seconds: float  # the horizon
    position_mm: float = field(metadata=INFINITE)
    heading_deg: float = field(metadata=INFINITE)
    relative: float = field(
        metadata=INFINITE
    )  # to the noise of a pose: of position or heading, the larger one


def change(
    runs: Sequence[_core.RunData],
    chosen: Sequence[_core.Window],
    seconds: float,
    models: Tuple[_core.Model, _core.Model],
) -> PredictionChange:
    """The PredictionChange between the predicted_poses of two models; infinite where a motion is not
    finite."""
    try:
        a, b = (predicted_poses(runs, model, chosen, seconds) for model in models)
    except Diverged:
        return PredictionChange(seconds, np.inf, np.inf, np.inf)
    position, heading = np.sqrt((apart(a, b) ** 2).mean(axis=0)).tolist()
    relative = np.array([position, heading]) / pose_noise(runs)
    return PredictionChange(seconds, position, heading, float(relative.max()))


def pose_noise(runs: Sequence[_core.RunData]) -> Array:
    """Distances of position [mm] and heading [deg] that the noise of a pose alone causes, rms over
    runs, (2,)."""
    noise = np.array([run.noise for run in runs])
    position = np.sqrt(np.mean(noise[:, 0] ** 2 + noise[:, 1] ** 2))
    return np.array([1e3 * position, np.degrees(np.sqrt(np.mean(noise[:, 2] ** 2)))])


def what_matters(runs: Sequence[_core.RunData]) -> Array:
    """Least change of predicted position [mm] and heading [deg] that matters, (2,), by default: five
    times the noise of a pose, which can be seen without statistics (Rose's criterion). More data make an
    effect more certain, not larger. For a palm-sized craft a delay of 1.4 ms reaches it."""
    return 5 * pose_noise(runs)


def apart(a: Array, b: Array) -> Array:
    """Distances of position [mm] and heading [deg] between poses (n, 3), (n, 2)."""
    off = a - b
    position = 1e3 * np.hypot(off[:, 0], off[:, 1])
    return np.column_stack([position, np.degrees(np.abs(angles.wrap(off[:, 2])))])
