"""Predicted poses at the horizon that suits a craft: the size of an error, or of an effect, as a
person sees it."""

from dataclasses import dataclass
from typing import List, Optional, Sequence, Tuple

import numpy as np

from ground import _core
from ground.analysis.likelihood import call
from ground.recordings import repair, windows
from ground.support.annotations import Array
from ground.support.errors import GroundError

LENGTHS = 20.0  # travelled at full thrust within the horizon [radii of gyration]; some five lengths
TURN = 2 * np.pi  # turned at full moment within the horizon [rad]
STEPS = (1.0, 2.0, 5.0)  # horizons are these times a power of ten [s]
MIN_POSES = 10  # intervals between poses in the shortest horizon
WARM_UP = 0.5  # time before a start that its initial velocities are fitted to [horizons]
MIN_STARTS = 4  # in all runs
MAX_STARTS = 160
SHOWN = 40  # predictions for a report


def horizon(runs: Sequence[_core.RunData], model: _core.Model) -> float:
    """Time [s] in which full thrust moves a craft by some lengths or turns it round: 1 s for a
    palm-sized hovercraft, 10 s for a free-flyer. Long enough for some poses, and short enough for some
    starts in the runs. Diagnoses use that of the given model for all models."""
    value = model.value
    least, most = _full_thrust(model)
    full = np.maximum(np.abs(least), most)
    radius = np.sqrt(value("I_z") / value("m"))
    way = np.array([LENGTHS * radius, LENGTHS * radius, TURN])
    mass = np.array([value("m"), value("m"), value("I_z")])
    damping = np.array([value("X_u"), value("Y_v"), value("N_r")])
    moved = full > 1e-9 * full[:2].max()
    way, mass, damping, full = (a[moved] for a in (way, mass, damping, full))
    # The time t with mass 2 way / t^2 + damping way / t = full.
    half = 0.5 * way * damping / full
    usual = float(np.min(half + np.sqrt(half**2 + 2 * way * mass / full)))
    step = float(np.median(np.concatenate([np.diff(np.array(run.times)) for run in runs])))
    return _shortened(runs, max(_nearest(usual), MIN_POSES * step), MIN_POSES * step)


def _shortened(runs: Sequence[_core.RunData], seconds: float, least: float) -> float:
    """The longest time up to some seconds after which runs have enough starts(); `least` if none has."""
    while seconds > least:
        if sum(len(_starts_in(run, i, seconds)) for i, run in enumerate(runs)) >= MIN_STARTS:
            return seconds
        seconds = _nearest(0.45 * seconds)
    return least


def _full_thrust(model: _core.Model) -> Array:
    """Least and most X, Y [N], N [N m] that the thrusters give, (2, 3)."""
    thrusters = model.thrusters
    ends = np.array([t["range"] for t in thrusters]) if thrusters else np.empty((0, 2))
    if model.is_pair or not len(ends):
        ends = np.array([[0.0, model.input_max]] * 2)
    scale = model.value("k") * np.array([1.0, 1.0, model.value("l")])
    each = np.array([model.forces(np.diag(ends[:, i])) * scale for i in (0, 1)])
    return np.array([each.min(axis=0).sum(axis=0), each.max(axis=0).sum(axis=0)])


def _nearest(seconds: float) -> float:
    """The nearest of STEPS times a power of ten."""
    power = np.floor(np.log10(seconds))
    near = np.array([step * 10.0 ** (power + i) for i in (0, 1) for step in STEPS])
    return float(near[np.argmin(np.abs(np.log(near / seconds)))])


def starts(runs: Sequence[_core.RunData], seconds: float, most: float = MAX_STARTS) -> List[_core.Window]:
    """Stretches of runs (_core.RunData) that end a horizon of some seconds after a start. They begin
    where the fit of the initial state does, and overlap. GroundError when no run is long enough."""
    found = [w for i, run in enumerate(runs) for w in _starts_in(run, i, seconds)]
    if not found:
        raise GroundError("no run is long enough for predictions over %.2g s" % seconds)
    return windows.spread(found, most)


def _starts_in(run: _core.RunData, index: int, seconds: float) -> List[_core.Window]:
    length, shift = (1 + WARM_UP) * seconds, WARM_UP * seconds
    begins = [run.times[0] + i * shift for i in range(int(np.ceil(length / shift)))]
    cut = [w for begin in begins for w in windows.cut_part(run, index, begin, run.times[-1], length)]
    return sorted(cut, key=lambda w: int(w.first))


def predicted_poses(
    runs: Sequence[_core.RunData], model: _core.Model, chosen: Sequence[_core.Window], seconds: float
) -> Array:
    """Poses x, y [m], psi [rad] that a model predicts at the ends of starts(), (n, 3). The initial
    velocities are the best for what was measured before each start. GroundError when a motion is not
    finite."""
    ends = np.empty((len(chosen), 3))
    for i, run in enumerate(runs):
        at = [k for k, window in enumerate(chosen) if window.run == i]
        if not at:
            continue
        own = [_core.Window(0, chosen[k].first, chosen[k].last) for k in at]
        begins = np.array(run.times)[[window.first for window in own]] + WARM_UP * seconds
        splits = np.searchsorted(np.array(run.times), begins)
        warm = [_core.Window(0, window.first, int(split)) for window, split in zip(own, splits)]
        begun = call(windows.problem([run], warm).simulate, model)["nu"]
        ended = call(_core.predict, model, run, own, np.array([nu[0] for nu in begun]))["eta"]
        ends[at] = [eta[-1] for eta in ended]
    return ends


def pose_errors(
    runs: Sequence[_core.RunData], model: _core.Model, chosen: Sequence[_core.Window], seconds: float
) -> Array:
    """Errors of position [mm] and heading [deg] of predicted_poses, (n, 2)."""
    measured = [np.array(run.poses if len(run.poses) else run.eta) for run in runs]
    ends = np.array([measured[window.run][window.last] for window in chosen])
    return _apart(predicted_poses(runs, model, chosen, seconds), ends)


@dataclass(frozen=True)
class Poses:
    """Root mean square errors of predicted position [mm] and heading [deg] at a horizon."""

    seconds: float  # the horizon
    before: Tuple[float, ...]  # of the model without the effects found
    now: Tuple[float, ...]  # with them
    after: Tuple[float, ...]  # with the formula for what is left, too
    noise: Tuple[float, ...]  # of a pose alone


def poses(runs: Sequence[_core.RunData], models: Sequence[_core.Model]) -> Optional[Poses]:
    """The Poses of models before, now and after; None where runs are too short or a motion is not finite."""
    seconds = horizon(runs, models[0])
    try:
        chosen = starts(runs, seconds, SHOWN)
        errors = [np.sqrt((pose_errors(runs, m, chosen, seconds) ** 2).mean(axis=0)) for m in models]
    except GroundError:
        return None
    before, now, after, noise = (tuple(e.tolist()) for e in [*errors, pose_noise(runs)])
    return Poses(seconds, before, now, after, noise)


@dataclass(frozen=True)
class Change:
    """Distance between the poses that two models predict at a horizon, rms over starts."""

    seconds: float  # the horizon
    position_mm: float
    heading_deg: float
    relative: float  # to the noise of a pose: of position or heading, the larger one


def change(
    runs: Sequence[_core.RunData],
    chosen: Sequence[_core.Window],
    seconds: float,
    models: Tuple[_core.Model, _core.Model],
) -> Change:
    """The Change between the predicted_poses of two models."""
    a, b = (predicted_poses(runs, model, chosen, seconds) for model in models)
    position, heading = np.sqrt((_apart(a, b) ** 2).mean(axis=0)).tolist()
    relative = np.array([position, heading]) / pose_noise(runs)
    return Change(seconds, position, heading, float(relative.max()))


def pose_noise(runs: Sequence[_core.RunData]) -> Array:
    """Distances of position [mm] and heading [deg] that the noise of a pose alone causes, rms over
    runs, (2,)."""
    noise = np.array([run.noise for run in runs])
    position = np.sqrt(np.mean(noise[:, 0] ** 2 + noise[:, 1] ** 2))
    return np.array([1e3 * position, np.degrees(np.sqrt(np.mean(noise[:, 2] ** 2)))])


def _apart(a: Array, b: Array) -> Array:
    off = a - b
    position = 1e3 * np.hypot(off[:, 0], off[:, 1])
    return np.column_stack([position, np.degrees(np.abs(repair.wrap(off[:, 2])))])
