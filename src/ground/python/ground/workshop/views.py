"""What the page draws of a run, as plain lists, thinned to what a screen shows."""

from dataclasses import asdict
from typing import Any, List, Optional

import numpy as np

from ground.comparing.predictor import Predictor
from ground.models import Model
from ground.recordings import quality
from ground.reports.appearance import scaled
from ground.support.annotations import Array, Document

MOST_POINTS = 1000  # of a curve
MOST_SECONDS = 120.0  # of a run that are predicted at once; a longer part is shown in its first ones


def end_of(start: float, end: float) -> float:
    """The end of a part that is not too long [s]."""
    return min(end, start + MOST_SECONDS)


def curves(ready: Predictor, model: Model, run: str, start: float, end: float) -> Document:
    """What a model predicts of a part of a run: t, u, v, r, x, y, and None between starts."""
    made = ready.motion(model, run, start, end_of(start, end))
    every = _every(len(made.times))
    jumps = np.flatnonzero(np.diff(made.start)) + 1
    at = np.unique(np.concatenate([np.arange(0, len(made.times), every), jumps, jumps - 1])).astype(int)
    at = at[(at >= 0) & (at < len(made.times))]
    new = np.flatnonzero(np.diff(made.start[at])) + 1
    columns = dict(zip(("x", "y", "psi", "u", "v", "r"), made.predicted[at].T))
    columns["t"] = made.times[at]
    return {name: _listed(np.insert(values, new, np.nan), 4) for name, values in columns.items()}


def measured(ready: Predictor, run: str, start: float, end: float) -> Document:
    """What was measured in a part of a run, and the commands."""
    data = ready.runs[ready.names.index(run)]
    times = np.array(data.times)
    inside = np.flatnonzero((times >= start) & (times <= end))
    at = inside[:: _every(len(inside))]
    eta, nu = np.array(data.eta)[at], np.array(data.nu)[at]
    columns = dict(zip(("x", "y", "psi", "u", "v", "r"), np.column_stack([eta, nu]).T))
    repaired = quality.repaired(ready.recordings[ready.names.index(run)])
    inputs = repaired.inputs(ready.model.core)
    kept = inputs[(inputs[:, 0] >= start) & (inputs[:, 0] <= end)]
    kept = kept[np.append(True, (np.diff(kept[:, 1:], axis=0) != 0).any(axis=1))] if len(kept) else kept
    kept = kept[:: _every(len(kept))]
    names = [*ready.model.core.channels]
    return {
        "t": _listed(times[at], 4),
        **{name: _listed(values, 4) for name, values in columns.items()},
        "commands": {"t": _listed(kept[:, 0], 4)},
        "channels": [{"name": n, "y": _listed(kept[:, i + 1], 3)} for i, n in enumerate(names[:-1])],
        "end": float(times[-1]),
    }


def missing(ready: Predictor, model: Model, run: str, start: float, end: float) -> Document:
    """The missing force and moment along a part of a run, with what it may depend on."""
    found = ready.missing(model, run, start, end_of(start, end))
    at = np.arange(0, len(found.times), _every(len(found.times)))
    times = found.times[at]
    data = ready.runs[ready.names.index(run)]
    nu = np.array([np.interp(times, data.times, column) for column in np.array(data.nu).T]).T
    inputs = quality.repaired(ready.recordings[ready.names.index(run)]).inputs(ready.model.core)
    held = inputs[np.maximum(0, np.searchsorted(inputs[:, 0], times, side="right") - 1)]
    channels: List[Document] = []
    for i, (name, entry) in enumerate(found.numbers["channels"].items()):
        factor, unit = scaled(entry)
        values, sigma = factor * found.wrench[at, i], factor * found.sigma[at, i]
        channels.append(
            {
                "name": name, "unit": unit, "y": _listed(values, 4), "low": _listed(values - 2 * sigma, 4),
                "high": _listed(values + 2 * sigma, 4), "rms": factor * entry["rms"],
                "full": factor * entry["full_scale"],
            }
        )  # fmt: skip
    return {
        "t": _listed(times, 4),
        "channels": channels,
        "against": {
            "speed [m/s]": _listed(np.hypot(nu[:, 0], nu[:, 1]), 4),
            "heading [deg]": _listed(np.degrees(found.heading[at]) % 360, 2),
            "turn rate [rad/s]": _listed(nu[:, 2], 4),
            **{
                "command " + name: _listed(held[:, 1 + k], 3)
                for k, name in enumerate(ready.model.core.channels[:-1])
            },
        },
        "x": _listed(found.position[at, 0], 4),
        "y": _listed(found.position[at, 1], 4),
        "left_out": found.numbers["disturbances"],
    }


def error(ready: Predictor, model: Model) -> Document:
    """The prediction error over all runs of a Predictor."""
    return {"seconds": ready.horizon, **asdict(ready.error(model))}


def _every(count: int) -> int:
    return max(1, -(-count // MOST_POINTS))


def _listed(values: Array, digits: int) -> List[Optional[float]]:
    rounded: List[Any] = np.round(np.asarray(values, float), digits).tolist()
    return [v if v == v and abs(v) != np.inf else None for v in rounded]
