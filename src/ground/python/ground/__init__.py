"""Identification, diagnosis and control of a miniature hovercraft.

`ground.read`, `info`, `fit`, `predict`, `compare`, `diagnose`, `discover`, `history`, `add`, `simulate` and
`track` return results, mostly as the programs of those names do. SI units; poses x, y [m], psi
[rad] in world_ned; velocities u, v [m/s], r [rad/s] and forces X, Y [N], N [N m] in the body frame; inputs
0..1. A wrong file or argument raises `GroundError` with one line that says what, where and why. What is
valid but probably a mistake gives a `GroundWarning`.
"""

from pkgutil import extend_path as _extend_path
from typing import TYPE_CHECKING, Any, List

# In catkin's devel space the compiled core is in another folder; a new process may find the sources first.
__path__ = _extend_path(__path__, __name__)

from ground.support import public as _public

# Public names by their module. A module is loaded on first use: those that a fit needs take a second.
_PUBLIC = {
    "effect_library.effects": "Effect EffectParameter Effects effects",
    "comparing.predict": "Prediction predict",
    "comparing.predictor": "Predictor",
    "fitting.add": "Addition add",
    "discovery.discover": "Discovery discover",
    "data.info": "Info info",
    "data.read": "read",
    "comparing.compare": "compare",
    "comparing.result": "Comparison RunComparison",
    "control.track": "Tracking track",
    "diagnosing.diagnose": "diagnose",
    "diagnosing.result": "Diagnosis",
    "equations.written": "ExportedModel",
    "exporting.recorded": "ExportedRun to_mcap",
    "support.errors": "GroundError GroundWarning OptionError",
    "fitting.fit": "fit",
    "fitting.result": "Fit",
    "ledger.history": "history",
    "ledger.result": "History",
    "models": "Fitted Model Parameter Room",
    "reading.recording": "Recording",
    "results.load": "load",
    "results.plot": "Figures plot",
    "simulation.simulate": "simulate",
    "simulation.simulated_run": "SimulatedRun",
    "workshop.workbench": "workbench",
}
_public.HOMES.update({n: "ground." + module for module, names in _PUBLIC.items() for n in names.split()})
if TYPE_CHECKING:
    from ground.comparing.compare import compare
    from ground.comparing.predict import Prediction, predict
    from ground.comparing.predictor import Predictor
    from ground.comparing.result import Comparison, RunComparison
    from ground.control.track import Tracking, track
    from ground.data.info import Info, info
    from ground.data.read import read
    from ground.diagnosing.diagnose import diagnose
    from ground.diagnosing.result import Diagnosis
    from ground.discovery.discover import Discovery, discover
    from ground.effect_library.effects import Effect, EffectParameter, Effects, effects
    from ground.equations.written import ExportedModel
    from ground.exporting.recorded import ExportedRun, to_mcap
    from ground.fitting.add import Addition, add
    from ground.fitting.fit import fit
    from ground.fitting.result import Fit
    from ground.ledger.history import history
    from ground.ledger.result import History
    from ground.models import Fitted, Model, Parameter, Room
    from ground.reading.recording import Recording
    from ground.results.load import load
    from ground.results.plot import Figures, plot
    from ground.simulation.simulate import simulate
    from ground.simulation.simulated_run import SimulatedRun
    from ground.support.errors import GroundError, GroundWarning, OptionError
    from ground.workshop.workbench import workbench

__all__ = [  # the names of _PUBLIC, repeated for type checkers
    "Addition",
    "Comparison",
    "Diagnosis",
    "Discovery",
    "Effect",
    "EffectParameter",
    "Effects",
    "Figures",
    "ExportedModel",
    "ExportedRun",
    "Fit",
    "Fitted",
    "GroundError",
    "GroundWarning",
    "History",
    "Info",
    "Model",
    "OptionError",
    "Parameter",
    "Prediction",
    "Predictor",
    "Recording",
    "Room",
    "RunComparison",
    "SimulatedRun",
    "Tracking",
    "add",
    "compare",
    "diagnose",
    "discover",
    "effects",
    "fit",
    "history",
    "info",
    "load",
    "plot",
    "predict",
    "read",
    "simulate",
    "to_mcap",
    "track",
    "workbench",
]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from ground._core import version as value
    else:
        value = _public.public(name)
    globals()[name] = value
    return value


def __dir__() -> List[str]:
    return sorted({*__all__, *(name for name in globals() if name.startswith("__"))})
