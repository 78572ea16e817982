"""The parameters of each run by itself, with the information that it has about them.

A run's likelihood (ground.analysis.likelihood) has a random wrench, a wrench that is constant in the run,
and the noise of the poses, but no difference of thrust: that is what its k tells. A parameter that a run
does not show has little information, not an error. Estimates are kept by the content of what they are of.
"""

import json
import os
from dataclasses import dataclass
from typing import Optional, Sequence, Tuple

import numpy as np

from ground import _core
from ground.analysis.likelihood import Likelihood, is_reciprocal
from ground.analysis.window_error import free_parameters
from ground.checks import quality, suspicions
from ground.effect_library.parameters import described
from ground.models import Model
from ground.reading import readers, recorded_files
from ground.reading.mapping import FieldMapping
from ground.support import files
from ground.support.annotations import Array, Document
from ground.support.errors import GroundError, sentence
from ground.support.origin import digest, digest_of_files

ASYMMETRY, LAGS = "thrust_asymmetry", ("motor_lag", "input_delay")  # effects that a craft may get with age
TRIMS = ("trim_X", "trim_Y", "trim_N")  # what differs between runs and is no parameter
OFFSET, OFFSET_EFFECT = "offset", "heading_offset"  # a suspicion, and the effect that it may be
MOST = 60.0  # of longer runs this much is used [s]
KEPT = 5  # version of what the cache has


@dataclass(frozen=True)
class EstimateTask:
    """A run to look at, in another process. model: text of the model file; empty: what is recorded with the
    the run is kept, but has no estimate."""

    path: str
    mapping: FieldMapping
    as_recorded: bool
    model: str = ""
    free: Tuple[str, ...] = ()


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


def looked_at(task: EstimateTask) -> Document:
    """What a run recorded, and its estimate if it is wanted, from the cache where they are known. A run that
    cannot be used has the reason under `failed`."""
    try:
        content = digest_of_files(recorded_files.contents(task.path, task.mapping))
        parts = [content, repr(task.mapping), task.model, *task.free, task.as_recorded, _core.version, KEPT]
        path = os.path.join(cache_folder(), digest(str(part).encode() for part in parts) + ".json")
        found = kept(path)
        if found is None:
            found = {"content": content, **_computed(task)}
            keep(path, found)
        return found
    except (GroundError, OSError) as error:
        return {"failed": sentence(error)}


def kept(path: str) -> Optional[Document]:
    """A document of the cache; None where there is none, or it is damaged."""
    try:
        with open(path) as file:
            found: Document = json.load(file)
    except (OSError, ValueError):
        return None
    return found if isinstance(found, dict) and "content" in found else None


def keep(path: str, found: Document) -> None:
    """Keeps a document if it can: a cache that cannot be written only costs time."""
    try:
        os.makedirs(os.path.dirname(path), exist_ok=True)
        files.write_json(path, found, force=True)
    except (GroundError, OSError):
        pass


def _computed(task: EstimateTask) -> Document:
    """GroundErrors of the run itself become `failed`, which the cache keeps, too."""
    try:
        recording = readers.read(task.path, task.mapping)
        flown = recording.files.get("model")
        recorded = {
            "first_stamp": float(np.min(recording.pose_times)),
            "model_name": recording.flown_by.get("model"),
            "model": flown.text if flown else None,
        }
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
        return {**recorded, **estimate(run.data(model.core, end=start + MOST), model.core, task.free)}
    except GroundError as error:
        return {"failed": sentence(error)}


def estimate(run: _core.RunData, model: _core.Model, free: Sequence[str]) -> Document:
    """The likeliest parameters of a run: `coordinates` (in units of `scale`) and their information matrix,
    and the length [s] of what was used. GroundError when the model cannot be simulated."""
    fit = Likelihood([run], model, TRIMS).fit(model, list(free))
    values = np.array([fit.model.value(name) for name in free])
    values[reciprocal(model, free)] **= -1
    information = np.where(np.isfinite(fit.information), fit.information, 0.0)
    return {
        "free": list(free),
        "scale": fit.scale.tolist(),
        "coordinates": (values / fit.scale).tolist(),
        "information": (0.5 * (information + information.T)).tolist(),
        "length": float(run.times[-1] - run.times[0]),
        "converged": bool(fit.converged),
        "trim": np.asarray(fit.trims[0]["wrench"]).tolist(),
    }


def reciprocal(model: _core.Model, names: Sequence[str]) -> Array:
    """Whether the coordinate of a parameter is its reciprocal (flags)."""
    known = described(model)
    return np.array([is_reciprocal(known[name]) for name in names])
