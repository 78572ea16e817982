"""The parameters of each run by itself, with the information that it has about them.

A run's likelihood (ground.analysis.likelihood) has a random wrench, a wrench that is constant in the run,
and the noise of the poses, but no difference of thrust: that is what its k tells. A parameter that a run
does not show has little information, not an error. Estimates are kept by the content of what they are of.
"""

import json
import os
from dataclasses import dataclass, replace
from typing import List, Optional, Sequence, Tuple, Type, TypeVar

import numpy as np

from ground import _core
from ground.analysis.likelihood import Likelihood, is_reciprocal
from ground.analysis.window_error import free_parameters
from ground.checks import quality, suspicions
from ground.effect_library.parameters import described
from ground.models import Model
from ground.reading import readers, recorded_files
from ground.reading.mapping import FieldMapping
from ground.support import files, records
from ground.support.annotations import Array
from ground.support.errors import GroundError, sentence
from ground.support.origin import digest, digest_of_files

ASYMMETRY, LAGS = "thrust_asymmetry", ("motor_lag", "input_delay")  # effects that a craft may get with age
TRIMS = ("trim_X", "trim_Y", "trim_N")  # what differs between runs and is no parameter
OFFSET, OFFSET_EFFECT = "offset", "heading_offset"  # a suspicion, and the effect that it may be
MAX_SECONDS = 60.0  # of longer runs this much is used [s]
KEPT = 6  # version of what the cache has
_T = TypeVar("_T")


@dataclass(frozen=True)
class EstimateTask:
    """A run to look at, in another process. model: text of the model file; empty: what is recorded with the
    the run is kept, but has no estimate."""

    path: str
    mapping: FieldMapping
    as_recorded: bool
    model: str = ""
    free: Tuple[str, ...] = ()


@dataclass(frozen=True)
class RunEstimate:
    """The likeliest parameters of a run."""

    free: List[str]  #: names of the parameters
    scale: List[float]  #: unit of each coordinate
    coordinates: List[float]
    information: List[List[float]]  #: matrix about the coordinates
    length: float  #: of what was used [s]


@dataclass(frozen=True)
class RecordedRun:
    """What a run recorded, and its estimate if there is a model."""

    content: str = ""  #: digest
    first_stamp: float = 0.0  #: of the poses [s]
    model_name: Optional[str] = None  #: of the file of the model that was recorded
    model: Optional[str] = None  #: text of that file
    estimate: Optional[RunEstimate] = None
    failed: str = ""  #: why the run cannot be used


def cache_folder() -> str:
    """Where estimates are kept: $XDG_CACHE_HOME/ground/history, else ~/.cache/ground/history."""
    home = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
    return os.path.join(home, "ground", "history")


def followed(model: Model, wanted: Optional[Sequence[str]] = None) -> Tuple[Model, Tuple[str, ...]]:
    """The model with the effects that are followed, and the names of the free parameters: parameters of
    `fit`, of the model's effects, asymmetry, and a lag (a delay is not distinguished, so that it shows here,
    too); of crafts with more than two thrusters the gain of each but the first. GroundError for a wanted one
    that does not exist."""
    thrusters = [t["name"] for t in model.core.thrusters]
    gains = ["thruster_gain_" + name for name in thrusters[1:]] if len(thrusters) > 2 else []
    lags = [] if set(LAGS) & set(model.effects) else LAGS[:1]
    for effect in [*(gains or [ASYMMETRY]), *lags]:
        if effect not in model.effects:
            try:
                model = model.with_effect(effect)
            except GroundError:  # this craft cannot have it
                continue
    known = free_parameters(model.core)
    for name in wanted or ():
        if name not in known:
            raise GroundError("the model has no parameter '%s'; it has %s" % (name, " ".join(known)))
    return model, tuple(name for name in known if not wanted or name in wanted)


def looked_at(task: EstimateTask) -> RecordedRun:
    """What a run recorded, and its estimate if it is wanted, from the cache where they are known."""
    try:
        content = digest_of_files(recorded_files.contents(task.path, task.mapping))
        parts = [content, repr(task.mapping), task.model, *task.free, task.as_recorded, _core.version, KEPT]
        path = os.path.join(cache_folder(), digest(str(part).encode() for part in parts) + ".json")
        found = kept(RecordedRun, path)
        if found is None:
            found = _computed(task, content)
            keep(path, found)
        return found
    except (GroundError, OSError) as error:
        return RecordedRun(failed=sentence(error))


def kept(kind: Type[_T], path: str) -> Optional[_T]:
    """A dataclass that the cache has; None where it has none, or it is damaged."""
    try:
        with open(path) as file:
            return records.read(kind, json.load(file), path)
    except (OSError, ValueError, GroundError):
        return None


def keep(path: str, found: object) -> None:
    """Keeps a dataclass if it can: a cache that cannot be written only costs time."""
    try:
        os.makedirs(os.path.dirname(path), exist_ok=True)
        files.write_json(path, records.plain(found), force=True)
    except (GroundError, OSError):
        pass


def _computed(task: EstimateTask, content: str) -> RecordedRun:
    """GroundErrors of the run itself become `failed`, which the cache keeps, too."""
    try:
        recording = readers.read(task.path, task.mapping)
        flown = recording.files.get("model")
        recorded = RecordedRun(
            content,
            float(np.min(recording.pose_times)),
            recording.flown_by.get("model"),
            flown.text if flown else None,
        )
        if not task.model:
            return recorded
        model = Model.parse(task.model, "the model of %s" % task.path)
        recording = recording.with_lift_of(model.core)
        for one in suspicions.about([recording], model.core):
            # no search asks here whether an offset of the heading is an effect, as a diagnosis does
            wrong = one.misread or (one.kind == OFFSET and OFFSET_EFFECT not in model.effects)
            if wrong and not task.as_recorded:
                raise GroundError("%s; --as-recorded uses it as it is" % one.sentence)
        run = quality.repaired(recording)
        start = run.spans[0][0] if run.spans else 0.0
        used = run.data(model.core, end=start + MAX_SECONDS)
        return replace(recorded, estimate=estimate(used, model.core, task.free))
    except GroundError as error:
        return RecordedRun(content, failed=sentence(error))


def estimate(run: _core.RunData, model: _core.Model, free: Sequence[str]) -> RunEstimate:
    """The likeliest parameters of a run. GroundError when the model cannot be simulated."""
    fit = Likelihood([run], model, TRIMS).fit(model, list(free))
    values = np.array([fit.model.value(name) for name in free])
    values[reciprocal(model, free)] **= -1
    information = np.where(np.isfinite(fit.information), fit.information, 0.0)
    return RunEstimate(
        list(free),
        fit.scale.tolist(),
        (values / fit.scale).tolist(),
        (0.5 * (information + information.T)).tolist(),
        float(run.times[-1] - run.times[0]),
    )


def reciprocal(model: _core.Model, names: Sequence[str]) -> Array:
    """Whether the coordinate of a parameter is its reciprocal (flags)."""
    known = described(model)
    return np.array([is_reciprocal(known[name]) for name in names])
