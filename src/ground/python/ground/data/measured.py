"""Recordings: reading them, and choosing the part that models are compared with."""

import functools
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Dict, List, Optional, Sequence

from ground import _core
from ground.data import voltage
from ground.data.read import NO_RECORDING, Recordings, both, distinct, taken
from ground.models import Model
from ground.reading.recording import Recording
from ground.support.command_line import option, positive, seconds
from ground.support.errors import GroundError, GroundNote, warn
from ground.support.progress import Work

if TYPE_CHECKING:
    from ground.checks import suspicions
    from ground.checks.quality import RepairedRun

CHECKING = "checking recordings"  # stage
WORTH_REPAIRING = 2e4  # poses from which several processes repair recordings sooner


def repaired(
    found: Sequence[Recording],
    work: Work,
    model: Optional[_core.Model] = None,
    others: Sequence[Recording] = (),
) -> "List[RepairedRun]":
    """The recordings with their motion repaired, which takes time. A mocap smooths all of them or none, so
    that the recording of a RepairedRun may be a copy; the given ones stay as they are.

    work: counts the repaired ones. model: of the craft, whose channels are then judged in each recording.
    others: recordings of the same mocap from `repaired`, which decide whether it smooths."""
    from ground.checks import quality, suspicions
    from ground.support.workers import Workers

    thrusters = suspicions.judged_by(found, model)
    poses = sum(len(recording.eta) for recording in found)
    with work.stage(CHECKING, len(found)):
        if len(found) > 1 and poses > WORTH_REPAIRING:
            known = Workers(processes=True).map(functools.partial(_repaired, thrusters), found)
            for recording, one in zip(found, work.each(known)):
                recording.known.update(one)
                quality.repaired(recording).recording = recording
        else:
            list(work.each(map(quality.repaired, found)))
        return [quality.repaired(recording) for recording in _smoothed_alike(found, others)]


def _smoothed_alike(found: Sequence[Recording], others: Sequence[Recording]) -> Sequence[Recording]:
    """The recordings with the low-pass of their mocap; others: as `repaired` takes them."""
    alone = [recording.motion.low_pass for recording in found]
    decided = [recording.motion.low_pass for recording in others]
    answers = [one is not None for one in alone] + [any(decided)] * bool(decided)
    if all(answers) or not any(answers):
        return found
    from ground.poses import smoothed

    seen = [(r.thrust, r.averaged, r.as_before(None) if r.motion.low_pass else r.motion) for r in found]
    return [
        recording if one == own else recording.with_low_pass(one)
        for recording, own, one in zip(found, alone, smoothed.shared(alone, seen, decided))
    ]


def _repaired(thrusters: "suspicions.Thrusters", recording: Recording) -> Dict[str, object]:
    """What a Recording knows when it has been repaired and looked at."""
    from ground.checks import quality, suspicions

    quality.repaired(recording)
    suspicions.of(recording)
    if thrusters:
        suspicions.alone(recording, thrusters)
    return {**recording.known, "motion": recording.motion}


def note_differences(found: Sequence[Recording], others: Sequence[Recording] = ()) -> None:
    """Warns if runs, of these and of `others`, were recorded with different settings."""
    from ground.checks import findings

    different = findings.differences([*others, *found])
    if different and different != findings.differences(others):
        warn(different, GroundNote)


def note_suspicions(found: Sequence[Recording], model: Model) -> None:
    """Warns of mistakes that recordings of a model's craft look like."""
    from ground.checks import suspicions

    for finding in suspicions.about(found, model.core):
        warn(finding.sentence)


@dataclass(frozen=True)
class Part:
    """The part of every run that is used, on the run's clock."""

    start: float = option(0.0, "start, on the run's clock [s]", name="--from", type=seconds, metavar="S")
    end: Optional[float] = option(None, "end, on the run's clock [s]", name="--to", type=seconds, metavar="S")
    everything: bool = option(False, "use the whole recording, not only what info calls usable", name="--all")
    window: Optional[float] = option(
        None,
        "length of windows over which errors are taken [s] (1.5 times the time full thrust takes to move "
        "the craft some lengths or turn it round)",
        type=positive,
        metavar="S",
    )

    def of(self, run: "RepairedRun", model: Model) -> _core.RunData:
        """_core.RunData of that part of a run. GroundError when nothing is left of it."""
        return run.data(model.core, self.start, self.end, self.everything, self.window)


@dataclass(frozen=True)
class Measured:
    """Recordings as fits use them."""

    recordings: List[Recording]
    data: List[_core.RunData]
    findings: "List[suspicions.Suspicion]"  #: mistakes that the recordings look like

    @property
    def runs(self) -> "List[RepairedRun]":
        """The recordings with their motion repaired."""
        from ground.checks import quality

        return [quality.repaired(recording) for recording in self.recordings]

    def refuse_misread(self) -> None:
        """GroundError when the recordings look misread, so that a model of them would be wrong."""
        for finding in self.findings:
            if finding.misread:
                raise GroundError(
                    "%s; --as-recorded (as_recorded in Python) uses it as it is" % finding.sentence
                )


def measured(
    given: Recordings, model: Model, part: Part, work: Work, others: Sequence[Recording] = ()
) -> Measured:
    """Recordings to fit to or to test on; work: told of what is done; others: those that were fitted to, if
    these are held out. Warns of possible errors of a recording's repair, and of settings that differ
    among these and `others`. GroundError when a recording cannot be used.
    """
    from ground.checks import findings, suspicions

    if not model.core.input_max > 0:
        raise GroundError("the model's input_max is not positive")
    found = [recording.with_lift_of(model.core) for recording in taken(given)]
    if not found:
        raise GroundError(NO_RECORDING)
    note_differences(found, others)
    runs = repaired(found, work, model.core, others)
    found = [run.recording for run in runs]
    doubts = suspicions.about(found, model.core)
    for run in runs:
        doubts += suspicions.changed(run, part.start, math.inf if part.end is None else part.end)
    told = [
        "%s: %s" % (d["name"], text) for d in findings.describe(runs, doubts) for text in findings.grave(d)
    ]
    told += [one.sentence for one in doubts if len(one.runs) > 1]
    # Unless misread recordings are used anyway, the refusal or the answer tells the first reason.
    misread = [one.sentence for one in doubts if one.misread and not getattr(part, "as_recorded", True)]
    for text in told:
        if text not in misread[:1]:
            warn(text)
    voltage.note_missing(model, found)
    data = [part.of(run, model) for run in runs]
    return Measured(found, data, doubts)


def held_out(given: Recordings, model: Model, part: Part, work: Work, fitted: Measured) -> Measured:
    """Recordings to test on, measured; work: told of what is done. There may be none. GroundError when
    one of them is fitted to as well, also under another name."""
    found = taken(given)
    if not found:
        return Measured([], [], [])
    known = {recording.identity: recording for recording in fitted.recordings}
    for one in found:
        if one.identity in known:
            raise GroundError(
                "a run is given both for the fit and as holdout: %s" % both(known[one.identity], one)
            )
    return measured(distinct(found, fitted.recordings), model, part, work, fitted.recordings)
