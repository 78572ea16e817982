"""Models, recordings and what models make of them, as the structs of a .mat file."""

import re
from dataclasses import dataclass
from typing import Any, List, Mapping, NamedTuple, Optional, Sequence

import numpy as np

from ground import _core
from ground.analysis import comparison
from ground.effect_library.parameters import described
from ground.models import Model
from ground.poses import angles
from ground.support import files, records
from ground.support.annotations import Array, Path

ABOUT = (
    "SI units. eta: x, y [m], psi [rad], world_ned. nu: u, v [m/s], r [rad/s], body. t, eta, nu and "
    "inputs have a row for each sample of a run, commands one for each command: time [s] and inputs. "
    "predicted: what each model predicts in windows from the measured pose, NaN "
    "between them; residual: measured minus predicted eta and nu; position_mm and heading_deg: how far "
    "off the predicted pose is. after: the same, rms, some seconds after a start."
)


@dataclass(frozen=True)
class ModelStruct:
    """A model in a .mat file."""

    label: str
    name: str
    effects: List[str]
    file: str  # its text


@dataclass(frozen=True)
class ParameterStruct:
    """A parameter of a model in a .mat file."""

    model: str
    name: str
    value: float
    unit: str
    meaning: str
    ci95: Array  # (1, 2)
    identified: bool


@dataclass(frozen=True)
class HorizonStruct:
    """How far predicted poses are off after some time; None: no run is long enough."""

    seconds: float
    position_mm: Optional[float]
    heading_deg: Optional[float]


@dataclass(frozen=True)
class PredictedStruct:
    """What a model makes of a run in a .mat file; arrays have a row for each sample."""

    model: str
    eta: Array
    nu: Array
    residual: Array
    position_mm: Array
    heading_deg: Array
    after: List[HorizonStruct]


@dataclass(frozen=True)
class RunStruct:
    """A run in a .mat file; arrays have a row for each sample, commands for each command."""

    name: str
    t: Array
    eta: Array
    nu: Array
    inputs: Array
    input_names: List[str]
    commands: Array
    predicted: List[PredictedStruct]


class Study(NamedTuple):
    """A recording, and what each model makes of it."""

    run: _core.RunData
    evaluations: Mapping[str, comparison.Evaluation]  #: by label of the model


def studies(models: Mapping[str, Model], runs: Sequence[_core.RunData]) -> List[Study]:
    """Evaluates models on recordings."""
    return [
        Study(run, {label: comparison.evaluate(run, model.core) for label, model in models.items()})
        for run in runs
    ]


def write(
    path: Path, models: Mapping[str, Model], studied: Sequence[Study], force: bool = False, **more: Any
) -> None:
    """Writes a .mat file with about, models, parameters, runs and more. models: by label. GroundError when
    the file cannot be written."""
    from scipy import io

    contents = {
        "about": ABOUT,
        "models": [
            ModelStruct(label, model.name, list(model.effects), model.format())
            for label, model in models.items()
        ],
        "parameters": [row for label, model in models.items() for row in _parameters(label, model)],
        "runs": [_run(models, study) for study in studied],
        **more,
    }
    with files.new_file(str(path), force) as temporary:
        with open(temporary, "wb") as file:
            io.savemat(
                file,
                _value(records.plain(contents)),
                long_field_names=True,
                do_compression=True,
                oned_as="column",
            )


def _parameters(label: str, model: Model) -> List[ParameterStruct]:
    provenance = model.core.provenance
    return [
        ParameterStruct(
            label,
            p.name,
            model[p.name],
            p.unit,
            p.doc,
            np.array([provenance.confidence_95.get(p.name, (np.nan, np.nan))]),
            p.name in provenance.confidence_95 and p.name not in provenance.not_identified,
        )
        for p in described(model.core).values()
    ]


def _run(models: Mapping[str, Model], study: Study) -> RunStruct:
    run, channels = study.run, next(iter(models.values())).core.channels
    times, commands = np.array(run.times), np.array(run.inputs)
    at = np.searchsorted(commands[:, 0], times, side="right") - 1
    inputs = np.where((at >= 0)[:, np.newaxis], commands[np.maximum(at, 0), 1:], 0.0)
    return RunStruct(
        name=run.name,
        t=times[:, np.newaxis],
        eta=np.array(run.eta),
        nu=np.array(run.nu),
        inputs=inputs,
        input_names=list(channels),
        commands=commands,
        predicted=[_predicted(label, run, found) for label, found in study.evaluations.items()],
    )


def _predicted(label: str, run: _core.RunData, found: comparison.Evaluation) -> PredictedStruct:
    """What a model makes of a run."""
    measured = np.column_stack([np.array(run.eta), np.array(run.nu)])
    simulated = np.full(measured.shape, np.nan)
    for piece in found.pieces:
        simulated[piece["index"]] = np.column_stack([piece["eta"], piece["nu"]])
    residual = measured - simulated
    residual[:, 2] = angles.wrap(residual[:, 2])
    numbers = comparison.numbers([found])
    return PredictedStruct(
        model=label,
        eta=simulated[:, :3],
        nu=simulated[:, 3:],
        residual=residual,
        position_mm=1e3 * np.hypot(residual[:, :1], residual[:, 1:2]),
        heading_deg=np.degrees(np.abs(residual[:, 2:3])),
        after=[
            HorizonStruct(row["seconds"], row["position_mm"], row["heading_deg"])
            for row in numbers["horizons"]
        ],
    )


def _value(value: Any) -> Any:
    """A value as scipy writes it: dictionaries as structs, lists of them as arrays of structs, lists of
    texts as cells, None as NaN."""
    if isinstance(value, dict):
        return {_field(name): _value(item) for name, item in value.items()}
    if isinstance(value, list) and value and isinstance(value[0], dict):
        names = [_field(name) for name in value[0]]
        structs = np.zeros((1, len(value)), dtype=[(name, object) for name in names])
        for place, item in enumerate(value):
            structs[0, place] = tuple(_value(one) for one in item.values())
        return structs
    if isinstance(value, list):
        return np.array(value, dtype=object)
    return np.nan if value is None else value


def _field(name: str) -> str:
    """A name that MATLAB takes: letters, digits and _, a letter first, at most 63."""
    plain = re.sub(r"\W", "_", name, flags=re.ASCII)
    return (plain if plain[:1].isalpha() else "x" + plain)[:63]
