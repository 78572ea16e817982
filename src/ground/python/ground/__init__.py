"""Identification, diagnosis and control of a miniature hovercraft.

`ground.read`, `fit`, `compare`, `diagnose`, `discover`, `add`, `simulate` and `track` do what the programs of
the same names do and give frozen results. SI units; poses x, y [m], psi [rad] in world_ned;
velocities u, v [m/s], r [rad/s] and forces X, Y [N], N [N m] in the body frame; inputs 0..1. A
wrong file or argument raises `GroundError` with one line that says what, where and why. What is
valid but probably a mistake gives a `GroundWarning`.
"""
import os
from typing import TYPE_CHECKING, Any, List

# Ceres logs rejected steps; error messages quote its summary, which has what matters.
os.environ.setdefault("GLOG_minloglevel", "3")

# Public name: its module. A module is loaded on first use: those that a fit needs take a second.
_HOMES = {
    "Addition": "ground.api.adding",
    "Comparison": "ground.api.comparing",
    "Diagnosis": "ground.api.diagnosing",
    "Discovery": "ground.api.discovering",
    "Fit": "ground.api.fitting",
    "GroundError": "ground.errors",
    "GroundWarning": "ground.errors",
    "Model": "ground.api.models",
    "OptionError": "ground.errors",
    "Parameter": "ground.api.models",
    "Recording": "ground.recordings.recording",
    "Room": "ground.api.models",
    "RunComparison": "ground.api.comparing",
    "SimulatedRun": "ground.simulation.experiments",
    "Tracking": "ground.api.tracking",
    "add": "ground.api.adding",
    "compare": "ground.api.comparing",
    "diagnose": "ground.api.diagnosing",
    "discover": "ground.api.discovering",
    "fit": "ground.api.fitting",
    "read": "ground.api.recordings",
    "simulate": "ground.api.simulating",
    "track": "ground.api.tracking",
}
if TYPE_CHECKING:
    from ground.api.adding import Addition, add
    from ground.api.comparing import Comparison, RunComparison, compare
    from ground.api.diagnosing import Diagnosis, diagnose
    from ground.api.discovering import Discovery, discover
    from ground.api.fitting import Fit, fit
    from ground.api.models import Model, Parameter, Room
    from ground.api.recordings import read
    from ground.api.simulating import simulate
    from ground.api.tracking import Tracking, track
    from ground.errors import GroundError, GroundWarning, OptionError
    from ground.recordings.recording import Recording
    from ground.simulation.experiments import SimulatedRun

__all__ = [  # the names of _HOMES, repeated for type checkers
    "Addition",
    "Comparison",
    "Diagnosis",
    "Discovery",
    "Fit",
    "GroundError",
    "GroundWarning",
    "Model",
    "OptionError",
    "Parameter",
    "Recording",
    "Room",
    "RunComparison",
    "SimulatedRun",
    "Tracking",
    "add",
    "compare",
    "diagnose",
    "discover",
    "fit",
    "read",
    "simulate",
    "track",
]


def __getattr__(name: str) -> Any:
    import importlib

    if name not in _HOMES:
        raise AttributeError("module 'ground' has no attribute '%s'" % name)
    value = getattr(importlib.import_module(_HOMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> List[str]:
    return sorted({*globals(), *_HOMES})
