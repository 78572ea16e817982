"""Recordings and repaired runs as columns: arrays of numbers and one JSON text.

Columns go to files and to other processes. They hold data only, and whoever reads them gets the same
numbers bit by bit.
"""

import json
from dataclasses import asdict
from typing import Any, Dict, List, NamedTuple, Tuple

import numpy as np

from ground.annotations import Array, Document
from ground.recordings import quality, repair
from ground.recordings.flown import RunFile
from ground.recordings.frame_clock import FrameClock
from ground.recordings.live_changes import LiveChange
from ground.recordings.recording import Recording
from ground.recordings.settings import Setting, Settings
from ground.recordings.suspicions import Suspicion

RECORDED = ("pose_times", "eta", "control_times", "controls", "drives")
NAMED = ("name", "source", "clock_offset", "warnings", "flown_by", "channels", "lift_channel", "digest")
MOVED = ("times", "measured", "eta", "nu", "nu_dot", "spikes", "jumps")
FOUND = ("zero", "end", "drives", "drives_by", "reply", "contacts", "active", "spans")


class Columns(NamedTuple):
    """Arrays by name, and all else as JSON."""

    facts: str
    arrays: Dict[str, Array]


def of_recording(recording: Recording) -> Columns:
    """The Columns of a Recording, without its path."""
    facts = {name: getattr(recording, name) for name in NAMED}
    settings = recording.settings
    facts["settings"] = {
        "changes": [asdict(change) for change in settings.changes],
        "sources": settings.sources,
        "taken": settings.taken,
    }
    facts["files"] = {kind: asdict(file) for kind, file in recording.files.items()}
    facts["changes"] = [asdict(change) for change in recording.changes]
    return _columns(facts, {name: getattr(recording, name) for name in RECORDED})


def recording_of(columns: Columns, path: str, cache: str = "") -> Recording:
    """The Recording at a path; cache: folder of its cache. Raises an exception of any kind when the
    columns are not those of a Recording."""
    facts = json.loads(columns.facts)
    settings = facts["settings"]
    plain: Document = {name: columns.arrays[name] for name in RECORDED}
    plain.update((name, facts[name]) for name in NAMED)
    plain["channels"] = tuple(facts["channels"])
    found = Recording(
        **plain,
        settings=Settings(
            tuple(Setting(**change) for change in settings["changes"]),
            settings["sources"],
            tuple(settings["taken"]),
        ),
        files={kind: RunFile(**file) for kind, file in facts["files"].items()},
        changes=[LiveChange(**change) for change in facts["changes"]],
        path=path,
        cache=cache,
    )
    poses, controls = len(found.pose_times), len(found.control_times)
    _check(found.eta, (poses, 3))
    _check(found.controls, (controls, len(found.channels)))
    _check(found.drives, (len(found.drives), 2))
    return found


def of_run(run: quality.Run) -> Columns:
    """The Columns of a repaired run, without its recording."""
    motion = run.motion
    facts = {name: getattr(run, name) for name in FOUND}
    facts.update(
        noise=motion.noise,
        repairs=motion.repairs,
        suspicions=[suspicion.describe() for suspicion in run.suspicions],
        clock=None,
    )
    arrays = {name: getattr(motion, name) for name in MOVED}
    if motion.clock is not None:
        clock = dict(vars(motion.clock))
        arrays["clock_times"], arrays["lateness"] = clock.pop("times"), clock.pop("lateness")
        facts["clock"] = clock
    return _columns(facts, arrays)


def run_of(columns: Columns, recording: Recording) -> quality.Run:
    """The repaired run of a Recording. Raises an exception of any kind when the columns are not those of
    a run."""
    facts, arrays = json.loads(columns.facts), columns.arrays
    clock = facts["clock"]
    if clock is not None:
        clock = FrameClock(times=arrays["clock_times"], lateness=arrays["lateness"], **clock)
    moved: Document = {name: arrays[name] for name in MOVED}
    position, heading = facts["noise"]
    motion = repair.Motion(
        **moved, noise=(position, heading), clock=clock, repairs=facts["repairs"]
    )
    count = len(motion.times)
    for name in MOVED:
        values = getattr(motion, name)
        _check(values, (count, 3)[: values.ndim])
    found: Document = {name: facts[name] for name in FOUND}
    for name in ("contacts", "spans"):
        found[name] = _pairs(found[name])
    found["active"] = tuple(found["active"])
    suspicions = [Suspicion(**suspicion) for suspicion in facts["suspicions"]]
    return quality.Run.restored(recording, motion, suspicions=suspicions, **found)


def _columns(facts: Document, arrays: Dict[str, Any]) -> Columns:
    """Columns with arrays whose layout in memory is the same after they were written."""
    whole = {n: a if a.flags.forc else np.ascontiguousarray(a) for n, a in arrays.items()}
    return Columns(json.dumps(facts), whole)


def _pairs(rows: List[List[float]]) -> List[Tuple[float, float]]:
    return [(a, b) for a, b in rows]


def _check(array: Array, shape: Tuple[int, ...]) -> None:
    if array.shape != shape:
        raise ValueError("an array has the shape %s, not %s" % (array.shape, shape))
