"""Predicted poses at the horizon that suits a craft: the size of an error, or of an effect, as a
person sees it."""

from dataclasses import dataclass
from typing import List, Optional, Sequence, Tuple

import numpy as np

from ground import _core
from ground.analysis.likelihood import call
from ground.annotations import Array
from ground.errors import GroundError
from ground.recordings import repair, windows

LENGTHS = 20.0  # travelled at full thrust within the horizon [radii of gyration]; some five lengths
TURN = 2 * np.pi  # turned at full moment within the horizon [rad]
STEPS = (1.0, 2.0, 5.0)  # horizons are these times a power of ten [s]
MIN_POSES = 10  # intervals between poses in the shortest horizon
WARM_UP = 0.5  # time before a start that its initial state is fitted to [horizons]
MIN_STARTS = 4  # in all runs
MAX_STARTS = 160
ITERATIONS = 2  # Gauss-Newton steps to the initial state, which begins at the smoothed one


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
    runs: Sequence[_core.RunData],
    model: _core.Model,
    chosen: Sequence[_core.Window],
    seconds: float,
    wrench: Optional[Sequence[Array]] = None,
) -> Array:
    """Poses x, y [m], psi [rad] that a model predicts at the ends of starts(), (n, 3). The initial
    states are the best for the poses before each start. wrench: for each run a known wrench
    (samples, 3) in the body's frame, held from sample to sample [N], [N m]. GroundError when a motion
    is not finite."""
    known = [_Run(run, None if wrench is None else wrench[i]) for i, run in enumerate(runs)]
    return np.array([known[w.run].predicted(model, w, seconds) for w in chosen])


def pose_errors(
    runs: Sequence[_core.RunData],
    model: _core.Model,
    chosen: Sequence[_core.Window],
    seconds: float,
    wrench: Optional[Sequence[Array]] = None,
) -> Array:
    """Errors of position [mm] and heading [deg] of predicted_poses, (n, 2)."""
    measured = np.array([_measured(runs[w.run])[w.last] for w in chosen])
    return _apart(predicted_poses(runs, model, chosen, seconds, wrench), measured)


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


def _measured(run: _core.RunData) -> Array:
    """Poses as measured, (n, 3); smoothed ones where a run has no others."""
    return np.array(run.poses if len(run.poses) else run.eta)


class _Run:
    """A run, and a known wrench along it."""

    def __init__(self, run: _core.RunData, wrench: Optional[Array]) -> None:
        self.run, self.wrench = run, wrench
        self.times, self.inputs = np.array(run.times), np.array(run.inputs)
        self.states = np.hstack([np.array(run.eta), np.array(run.nu)])  # smoothed
        self.measured = _measured(run)
        noise = np.array(run.noise)
        self.scale = np.concatenate([noise, noise / np.median(np.diff(self.times))])

    def predicted(self, model: _core.Model, window: _core.Window, seconds: float) -> Array:
        """The pose at the end of a window that a model predicts, from its start."""
        start = self.times[window.first] + WARM_UP * seconds
        warm = slice(window.first, int(np.searchsorted(self.times, start)) + 1)
        state = self.states[window.first]
        for _ in range(ITERATIONS):
            state = state + self._correction(model, warm, state)
        whole = slice(window.first, window.last + 1)
        return np.asarray(self._simulated(model, whole, state)[-1])

    def _correction(self, model: _core.Model, part: slice, state: Array) -> Array:
        """Gauss-Newton step of the state at the begin of a part, towards its poses as measured."""
        simulated = self._simulated(model, part, state)
        off = np.asarray(self.measured[part] - simulated)
        off[:, 2] = repair.wrap(off[:, 2])
        noise = self.scale[:3]
        jacobian = [
            (self._simulated(model, part, state + step) - simulated) / noise for step in np.diag(self.scale)
        ]
        design = np.reshape(jacobian, (6, -1)).T
        solved = np.linalg.lstsq(design, (off / noise).ravel(), rcond=None)[0]
        return np.asarray(self.scale * solved, float)

    def _simulated(self, model: _core.Model, part: slice, state: Array) -> Array:
        wrench = None if self.wrench is None else self.wrench[part]
        motion = call(
            _core.simulate, model, self.inputs, self.times[part], state[:3], state[3:],
            self.run.drives, wrench,
        )  # fmt: skip
        return np.asarray(motion["eta"])
