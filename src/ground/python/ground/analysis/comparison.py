"""Model against measurement: error numbers, as docs/theory/identification.md defines them."""

import contextlib
from dataclasses import asdict, dataclass
from typing import Dict, List, Optional, Sequence

import numpy as np

from ground import _core
from ground.analysis import horizon, windows
from ground.reading.recording import VELOCITY, unit
from ground.support.annotations import Array, Document
from ground.support.errors import GroundError

START = 4 / 15  # part of a window that gives the initial velocities of the pure prediction
HORIZONS = (0.1, 0.25, 0.5, 1.0, 2.0, 4.0)  # [time scales]


def thesis_objective(runs: Sequence[_core.RunData], model: _core.Model) -> Optional[float]:
    """(3.4) over one window, the first 4 s of a run: the mean over the runs that are long enough; None
    when none is."""
    values, span = [], 4.0
    for run in runs:
        start = run.times[0]
        # One simulation, also across a gap: only measurements are missing there.
        found = _core.cut_windows(run, 0, start, start + span, span, span)[:1]
        if found and run.times[found[0].last] - start >= 0.9 * span:
            problem = _core.SimulationError([run], found)
            values.append(problem.simulate(model, _core.Objective.thesis)["objective"])
    return float(np.mean(values)) if values else None


@dataclass(frozen=True)
class HorizonErrors:
    """Errors of poses predicted over a horizon."""

    seconds: float
    errors: Array  # (k, 2) [mm], [deg]


@dataclass
class Evaluation:
    """One run simulated by one model, and what is needed to pool it with others."""

    pieces: List[Dict[str, Array]]  # per window: times, measured and nu (n, 3), eta (n, 3), index of samples
    sigma: Array  # (3,) standard deviations of u, v, r in the run
    predicted: Array  # (m, 3) errors of the pure prediction [standard deviations]
    thesis: Optional[float]
    horizons: List[HorizonErrors]

    @property
    def by_window(self) -> Array:
        """Sum of the errors of u, v, r in each window, (windows,)."""
        off = [np.abs((piece["measured"] - piece["nu"]) / self.sigma) for piece in self.pieces]
        return np.array([window.mean(axis=0).sum() for window in off])

    def stacked(self, name: str) -> Array:
        """The velocities "measured" or "nu" (simulated) of all windows, (n, 3)."""
        return np.vstack([piece[name] for piece in self.pieces])


def evaluate(run: _core.RunData, model: _core.Model) -> Evaluation:
    """Simulates the run's windows and predicts over all horizons.

    Raises GroundError on runs that are too short, RuntimeError on models whose motion is not
    finite.
    """
    cut = windows.cut([run])
    windowed = windows.problem([run], cut)
    simulation = windowed.simulate(model)
    times, nu = np.array(run.times), np.array(run.nu)
    pieces = []
    for window, eta, simulated in zip(cut, simulation["eta"], simulation["nu"]):
        at = np.arange(window.first, window.last + 1)
        pieces.append({"index": at, "times": times[at], "measured": nu[at], "nu": simulated, "eta": eta})
    sigma = windowed.sigma(0)
    predicted = _predict(run, model, cut, sigma)
    return Evaluation(pieces, sigma, predicted, thesis_objective([run], model), _predict_horizons(run, model))


def _predict(run: _core.RunData, model: _core.Model, cut: Sequence[_core.Window], sigma: Array) -> Array:
    """Errors after the first part of windows; initial velocities are fitted to that part only."""
    times, nu = np.array(run.times), np.array(run.nu)
    starts, scored = [], []
    for window in cut:
        split = int(np.searchsorted(times, times[window.first] + START * windows.length([run])))
        if split - window.first >= 4 and split < window.last:
            starts.append(_core.Window(0, window.first, split))
            scored.append(window)
    if not starts:
        return np.zeros((0, 3))
    begun = _core.SimulationError([run], starts).simulate(model)["nu"]
    ended = _core.predict(model, run, scored, np.array([n[0] for n in begun]))["nu"]
    return np.vstack(
        [
            (simulated[start.last - start.first :] - nu[start.last : window.last + 1]) / sigma
            for start, window, simulated in zip(starts, scored, ended)
        ]
    )


def _predict_horizons(run: _core.RunData, model: _core.Model) -> List[HorizonErrors]:
    """Errors of poses predicted over HORIZONS."""
    rows = []
    for seconds in [round(part * windows.time_scale([run]), 9) for part in HORIZONS]:
        errors = np.empty((0, 2))
        with contextlib.suppress(GroundError):  # the run is too short
            chosen = horizon.starts([run], seconds)
            errors = horizon.pose_errors([run], [model] * len(chosen), chosen, seconds)
        rows.append(HorizonErrors(seconds, errors))
    return rows


def numbers(evaluations: Sequence[Evaluation]) -> Document:
    """Error numbers of one run, or pooled over several: every sample has the same weight."""
    measured = [e.stacked("measured") for e in evaluations]
    left = [own - e.stacked("nu") for own, e in zip(measured, evaluations)]
    residual = np.vstack(left)
    off = np.abs(np.vstack([own / e.sigma for own, e in zip(left, evaluations)])).mean(axis=0)
    predicted = np.vstack([e.predicted for e in evaluations])
    spread = sum(((own - own.mean(axis=0)) ** 2).sum(axis=0) for own in measured)
    theses = [e.thesis for e in evaluations if e.thesis is not None]
    return {
        "error": float(off.sum()),
        "error_by_channel": _by_channel(off),
        "prediction_error": float(np.abs(predicted).sum(axis=1).mean()) if len(predicted) else None,
        "thesis_objective": float(np.mean(theses)) if theses else None,
        "fit_percent": _by_channel(100 * (1 - np.sqrt((residual**2).sum(axis=0) / spread))),
        "rms": _by_channel(np.sqrt(np.mean(residual**2, axis=0))),
        "rms_units": {channel: unit(channel) for channel in VELOCITY},
        "horizons": [_horizon_numbers(rows) for rows in zip(*(e.horizons for e in evaluations))],
    }


def _by_channel(values: Array) -> Dict[str, float]:
    return dict(zip(VELOCITY, values.tolist()))


def _horizon_numbers(rows: Sequence[HorizonErrors]) -> Dict[str, Optional[float]]:
    errors = np.vstack([r.errors for r in rows])
    found = {"position_mm": None, "heading_deg": None}
    if len(errors):
        found = asdict(horizon.PoseError.of(errors))
    return {"seconds": rows[0].seconds, "starts": len(errors), **found}
