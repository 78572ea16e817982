"""Model against measurement: error numbers, as docs/theory/identification.md defines them."""

import contextlib
from dataclasses import dataclass
from typing import Dict, Iterable, List, Optional, Sequence

import numpy as np

from ground import _core
from ground.analysis import horizon
from ground.recordings import windows
from ground.support.annotations import Array, Document, Indices
from ground.support.errors import GroundError

START = 4 / 15  # part of a window that gives the initial velocities of the pure prediction
THESIS_SPAN = 4.0  # length of the thesis's objective [s]
HORIZONS = (0.1, 0.25, 0.5, 1.0, 2.0, 4.0)  # [time scales]
CHANNELS = ("u", "v", "r")
UNITS = {"u": "m/s", "v": "m/s", "r": "rad/s"}


def thesis_objective(run: _core.RunData, model: _core.Model) -> Optional[float]:
    """(3.4) over one window, the first 4 s of the run; None when the run is shorter."""
    start = run.times[0]
    # One simulation, also across a gap: only measurements are missing there.
    found = _core.cut_windows(run, 0, start, start + THESIS_SPAN, THESIS_SPAN, THESIS_SPAN)
    if not found or run.times[found[0].last] - start < 0.9 * THESIS_SPAN:
        return None
    problem = _core.SimulationError([run], found[:1])
    return float(problem.simulate(model, _core.Objective.thesis)["objective"])


def mean_thesis_objective(runs: Sequence[_core.RunData], model: _core.Model) -> Optional[float]:
    """Mean of thesis_objective over the runs that are long enough; None when none is."""
    found = [thesis_objective(run, model) for run in runs]
    values = [v for v in found if v is not None]
    return float(np.mean(values)) if values else None


@dataclass
class Evaluation:
    """One run simulated by one model, and what is needed to pool it with others."""

    pieces: List[Document]  # per window: times, measured and nu (n, 3), eta (n, 3), index of samples
    sigma: Array  # (3,) standard deviations of u, v, r in the run
    predicted: Array  # (m, 3) errors of the pure prediction [standard deviations]
    thesis: Optional[float]
    horizons: List[Document]  # per horizon: seconds, errors (k, 2) [mm], [deg]

    @property
    def by_window(self) -> Array:
        """Sum of the errors of u, v, r in each window, (windows,)."""
        off = [np.abs((piece["measured"] - piece["nu"]) / self.sigma) for piece in self.pieces]
        return np.array([window.mean(axis=0).sum() for window in off])

    @property
    def residual(self) -> Array:
        """Measured minus simulated velocities of all windows, (n, 3)."""
        return np.vstack([p["measured"] - p["nu"] for p in self.pieces])

    @property
    def index(self) -> Indices:
        """Samples of the run that `residual` belongs to, (n,)."""
        return np.concatenate([p["index"] for p in self.pieces])


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
        index = np.arange(window.first, window.last + 1)
        pieces.append(
            {
                "index": index,
                "times": times[index],
                "measured": nu[index],
                "nu": simulated,
                "eta": eta,
            }
        )
    sigma = windowed.sigma(0)
    return Evaluation(
        pieces,
        sigma,
        _predict(run, model, cut, sigma),
        thesis_objective(run, model),
        _predict_horizons(run, model),
    )


def _predict(run: _core.RunData, model: _core.Model, cut: Sequence[_core.Window], sigma: Array) -> Array:
    """Errors after the first part of windows; initial velocities are fitted to that part only."""
    times, nu = np.array(run.times), np.array(run.nu)
    starts, scored = [], []
    for window in cut:
        split = np.searchsorted(times, times[window.first] + START * windows.length([run]))
        if split - window.first >= 4 and split < window.last:
            starts.append(_core.Window(0, window.first, int(split)))
            scored.append(window)
    if not starts:
        return np.zeros((0, 3))
    begun = _core.SimulationError([run], starts).simulate(model)["nu"]
    ended = _core.predict(model, run, scored, np.array([n[0] for n in begun]))["nu"]
    errors = []
    for start, window, simulated in zip(starts, scored, ended):
        rest = slice(start.last, window.last + 1)
        errors.append((simulated[start.last - window.first :] - nu[rest]) / sigma)
    return np.vstack(errors)


def _predict_horizons(run: _core.RunData, model: _core.Model) -> List[Document]:
    """Errors of poses predicted over HORIZONS."""
    rows = []
    for seconds in [round(part * windows.time_scale([run]), 9) for part in HORIZONS]:
        errors = np.empty((0, 2))
        with contextlib.suppress(GroundError):  # the run is too short
            chosen = horizon.starts([run], seconds)
            errors = horizon.pose_errors([run], [model] * len(chosen), chosen, seconds)
        rows.append({"seconds": seconds, "errors": errors})
    return rows


def numbers(evaluations: Sequence[Evaluation]) -> Document:
    """Error numbers of one run, or pooled over several: every sample has the same weight."""
    normalised = np.vstack([e.residual / e.sigma for e in evaluations])
    predicted = np.vstack([e.predicted for e in evaluations])
    residual = np.vstack([e.residual for e in evaluations])
    spread = sum(_squares_about_mean(e) for e in evaluations)
    theses = [e.thesis for e in evaluations if e.thesis is not None]
    by_channel = np.abs(normalised).mean(axis=0)
    return {
        "error": float(by_channel.sum()),
        "error_by_channel": _by_channel(by_channel),
        "prediction_error": float(np.abs(predicted).sum(axis=1).mean()) if len(predicted) else None,
        "thesis_objective": float(np.mean(theses)) if theses else None,
        "fit_percent": _by_channel(100 * (1 - np.sqrt((residual**2).sum(axis=0) / spread))),
        "rms": _by_channel(np.sqrt(np.mean(residual**2, axis=0))),
        "rms_units": UNITS,
        "horizons": [
            _horizon_numbers([e.horizons[i] for e in evaluations])
            for i in range(len(evaluations[0].horizons))
        ],
    }


def _squares_about_mean(evaluation: Evaluation) -> Array:
    measured = np.vstack([p["measured"] for p in evaluation.pieces])
    return np.asarray(((measured - measured.mean(axis=0)) ** 2).sum(axis=0))


def _by_channel(values: Iterable[float]) -> Dict[str, float]:
    return dict(zip(CHANNELS, map(float, values)))


def _horizon_numbers(rows: Sequence[Document]) -> Document:
    errors = np.vstack([r["errors"] for r in rows])
    found: Document = {"seconds": rows[0]["seconds"], "starts": len(errors)}
    for values, name in zip(errors.T, ("position_mm", "heading_deg")):
        found[name] = float(np.sqrt(np.mean(values**2))) if len(values) else None
    return found
