"""What the page draws of a run, as plain lists, thinned to what a screen shows."""

import re
from dataclasses import dataclass
from typing import Any, Dict, List, Optional, Sequence

import numpy as np

from ground import Model, Predictor
from ground.support.annotations import Indices

MOST_POINTS = 1000  # of a curve
MOST_SECONDS = 120.0  # of a run that are predicted at once; a longer part is shown in its first ones
MOST_COMMANDS = 4  # that the missing wrench is drawn against
OUTSIDE = 0.05  # largest share of a run in which a true model leaves its 95% band
MOTION = ("x", "y", "psi", "u", "v", "r")


@dataclass(frozen=True)
class Span:
    """A part of a run, predicted by a model."""

    ready: Predictor
    model: Model
    run: str
    start: float  # [s]
    end: float  # [s]


def curves(part: Span) -> Dict[str, List[Optional[float]]]:
    """What a model predicts of a part of a run: t, x ... r, and None between starts."""
    end = min(part.end, part.start + MOST_SECONDS)
    made = part.ready.motion(part.model, part.run, part.start, end)
    jumps = np.flatnonzero(np.diff(made.start)) + 1
    at = np.union1d(_thinned(len(made.times)), np.concatenate([jumps, jumps - 1])).astype(int)
    new = np.flatnonzero(np.diff(made.start[at])) + 1
    columns = np.insert(np.column_stack([made.times, made.predicted])[at], new, np.nan, axis=0)
    return {name: _listed(values) for name, values in zip(("t", *MOTION), columns.T)}


def measured(part: Span) -> Dict[str, object]:
    """What was measured in a part of a run, and the commands."""
    frame = part.ready.measured(part.run, part.start, part.end)
    frame = frame.iloc[_thinned(len(frame))]
    return {
        **{name: _listed(frame[name]) for name in ("t", *MOTION)},
        "channels": [{"name": name, "y": _listed(frame[name], 3)} for name in _commands(frame)],
    }


def missing(part: Span) -> Dict[str, object]:
    """The missing force and moment along a part of a run, with what it may depend on."""
    end = min(part.end, part.start + MOST_SECONDS)
    whole = part.ready.missing(part.model, part.run, part.start, end)
    frame, channels = whole.iloc[_thinned(len(whole))], []
    for name, full in part.model.full_thrust.items():
        factor, milli = (1e3, "m") if full < 1 else (1.0, "")
        values, width = factor * frame[name], 2 * factor * frame[name + "_sigma"]
        channels.append(
            {
                "name": name, "unit": milli + ("N m" if name == "N" else "N"), "y": _listed(values),
                "low": _listed(values - width), "high": _listed(values + width),
                "rms": factor * float(np.sqrt((whole[name] ** 2).mean())), "full": factor * full,
                "stands_out": float((whole[name].abs() > 2 * whole[name + "_sigma"]).mean()) > OUTSIDE,
            }
        )  # fmt: skip
    return {
        **{name: _listed(frame[name]) for name in ("t", "x", "y")},
        "channels": channels,
        "against": {
            "speed [m/s]": _listed(np.hypot(frame["u"], frame["v"])),
            "heading [deg]": _listed(np.degrees(frame["psi"]) % 360, 2),
            "turn rate [rad/s]": _listed(frame["r"]),
            **{"command " + name: _listed(frame[name], 3) for name in _commands(frame)[:MOST_COMMANDS]},
        },
    }


def _commands(frame: Any) -> List[str]:
    """Columns of the thrusters' commands: behind the columns of the motion, before the lift's."""
    names = [name for name in frame if not re.fullmatch("[XYN](_sigma)?", name)]
    return names[1 + len(MOTION) : -1]


def _thinned(count: int) -> Indices:
    return np.arange(0, count, max(1, -(-count // MOST_POINTS)))


def _listed(values: Sequence[float], digits: int = 4) -> List[Optional[float]]:
    rounded: List[Any] = np.round(np.asarray(values, float), digits).tolist()
    return [v if v == v and abs(v) != np.inf else None for v in rounded]
