"""Recordings: reading them, and choosing the part that models are compared with."""

import functools
import glob
import os
from dataclasses import dataclass, replace
from typing import Any, Dict, Iterable, Iterator, List, Optional, Sequence, Tuple, Union

from ground import _core
from ground.data import voltage
from ground.models import Model
from ground.recordings import findings, quality, readers, smoothed, suspicions
from ground.recordings.mapping import DEFAULT, FieldMapping, load
from ground.recordings.quality import RepairedRun
from ground.recordings.recording import Recording
from ground.support.annotations import Path
from ground.support.command_line import option, positive, seconds
from ground.support.errors import GroundError, GroundNote, RecordingWarning, warn
from ground.support.files import path_of
from ground.support.progress import Work
from ground.support.results import distinct_labels
from ground.support.workers import Workers

Recordings = Union[Recording, Path, Iterable[Union[Recording, Path]]]
NO_RECORDING = "no recordings are given"


def read(
    bags: Union[Path, Iterable[Path]],
    *,
    axes: Optional[str] = None,
    heading_offset: Optional[float] = None,
    mapping: Union[Path, FieldMapping, None] = None,
    pose_topic: Optional[str] = None,
    command_topic: Optional[str] = None,
    body: Optional[str] = None,
    noise: Optional[Tuple[float, float]] = None,
    frame_rate: Optional[float] = None,
    stamps: Optional[str] = None,
    types: Union[Path, Sequence[Path]] = (),
    namespace: Optional[str] = None,
) -> Tuple[Recording, ...]:
    """The recordings in bags of ROS 1 and 2, MCAP files and tables.

    bags: a path or several; a folder stands for the bags in it, and a pattern (``flights/*.bag``) for those
    that match it. axes: world_ned x, y, z in the mocap's axes ("x, z, -y"); heading_offset: measured
    minus true heading [rad]; both replace what was recorded with the run. mapping: a mapping file, or its
    content; pose_topic, command_topic and body (child frame, or part of the topic's name) replace its
    own. noise: of the positions [m] and headings [rad], in place of the scatter of the poses; frame_rate: of
    the mocap's camera [Hz], in place of what late stamps say. stamps: "unpadded" where nanoseconds after the
    point have no leading zeros. types: .msg files, or folders of them, for types that a bag does not define.
    namespace: of the craft's topics, where a bag has several crafts.
    Runs of the same name get the names of their folders in front. GroundError when a bag cannot be read or is
    given twice, also as a copy; anything odd in a bag gives a GroundWarning.

    >>> run, = ground.read(bag)
    >>> run.name, run.eta.shape[1], run.controls.shape[1]  # x, y, psi; left, right, lift
    ('run', 3, 3)
    >>> list(run.to_frame().columns)
    ['t', 'x', 'y', 'psi', 'u', 'v', 'r', 'left', 'right', 'lift']
    """
    given_paths = bags if isinstance(bags, Iterable) and not isinstance(bags, str) else [bags]
    paths = [found for path in given_paths for found in _matching(path_of(path, "a recording"))]
    if mapping is None:
        mapping = FieldMapping()
    elif not isinstance(mapping, FieldMapping):
        mapping = load(os.fspath(mapping))
    files = [types] if isinstance(types, (str, os.PathLike)) else types
    own_types = [os.fspath(file) for file in files]
    given = mapping.with_options(
        pose_topic, command_topic, body, axes, heading_offset, noise, frame_rate, stamps, own_types, namespace
    )
    return tuple(reading(paths, given))


def _matching(path: str) -> List[str]:
    """The files that match a pattern, by name; the path itself if it is none. GroundError without any."""
    if os.path.exists(path) or not glob.has_magic(path):
        return [path]
    found = sorted(glob.glob(path, recursive=True))
    if not found:
        raise GroundError("%s: no file matches this pattern" % path)
    return found


READING = "reading recordings (kB)"  # stage; unit: a kilobyte
REPAIRING = "repairing recordings"  # stage
WORTH_REPAIRING = 2e4  # poses from which several processes repair recordings sooner


def reading(
    paths: Sequence[str], mapping: FieldMapping = DEFAULT, work: Optional[Work] = None
) -> Iterator[Recording]:
    """The recordings in bags and folders, all read before the first one is returned; work: told of
    each that is read."""
    found, work = [], work or Work()
    bags = readers.listed(paths, mapping)
    sizes = [readers.size(path) // 1000 for path in bags]
    with work.stage(READING, sum(sizes)):
        for path, size in zip(bags, sizes):
            found.append(readers.read(path, mapping))
            work.step(size)
            for warning in found[-1].warnings:
                warn("%s: %s" % (path, warning), RecordingWarning)
    yield from distinct(found)


def distinct(found: Sequence[Recording], others: Sequence[Recording] = ()) -> List[Recording]:
    """Recordings with names that differ from each other and from the names of others. GroundError when two
    are the same run, by their contents."""
    first: Dict[str, Recording] = {}
    for one in found:
        if one.identity in first:
            what = "bag" if one.path else "recording"
            same = _both(first[one.identity], one)
            raise GroundError("the same %s is given twice: %s" % (what, same))
        first[one.identity] = one
    names = distinct_labels(
        [one.name for one in found], [one.path for one in found], [one.name for one in others], "_"
    )
    return [
        one if one.name == name else replace(one, name=name, digest=one.identity)
        for one, name in zip(found, names)
    ]


def _both(one: Recording, other: Recording) -> str:
    """Two recordings of the same run."""
    names = [recording.path or recording.name for recording in (one, other)]
    return " and ".join(dict.fromkeys(names))


def taken(given: Recordings) -> List[Recording]:
    """The given recordings, and those in the given bags, with names of their own. GroundError when one is
    given twice."""
    if isinstance(given, Recording):
        return [given]
    if isinstance(given, (str, os.PathLike)):
        return list(read(given))
    if not isinstance(given, Iterable):
        given = [given]
    return distinct([r for one in given for r in ([one] if isinstance(one, Recording) else read(one))])


def repaired(
    found: Sequence[Recording], work: Work, model: Optional[_core.Model] = None
) -> List[RepairedRun]:
    """The recordings with their motion repaired, which takes time; work: told of each; model: of the craft,
    whose channels are then judged in each recording."""
    thrusters = suspicions.judged_by(found, model)
    poses = sum(len(recording.eta) for recording in found)
    with work.stage(REPAIRING, len(found)):
        if len(found) > 1 and poses > WORTH_REPAIRING:
            known = Workers(processes=True).map(functools.partial(_repaired, thrusters), found)
            for recording, one in zip(found, work.each(known)):
                recording.known.update(one)
                quality.repaired(recording).recording = recording
        else:
            list(work.each(map(quality.repaired, found)))
        _share_low_pass(found)
        return [quality.repaired(recording) for recording in found]


def _share_low_pass(found: Sequence[Recording]) -> None:
    """Takes all recordings as smoothed, or none, where some of them seem to be: a mocap smooths all alike."""
    alone = [recording.motion.low_pass for recording in found]
    if None not in alone or not any(alone):
        return
    seen = [(r.thrust, r.averaged, r.as_before(None) if r.motion.low_pass else r.motion) for r in found]
    for recording, own, one in zip(found, alone, smoothed.shared(alone, seen)):
        if one != own:
            recording.known.clear()
            recording.known["motion"] = recording.as_before(one)
            recording.__dict__.pop("motion", None)


def _repaired(thrusters: suspicions.Thrusters, recording: Recording) -> Dict[str, Any]:
    """What a Recording knows when it has been repaired and looked at."""
    quality.repaired(recording)
    suspicions.of(recording)
    if thrusters:
        suspicions.alone(recording, thrusters)
    return {**recording.known, "motion": recording.motion}


def note_differences(found: Sequence[Recording], others: Sequence[Recording] = ()) -> None:
    """Warns if runs, of these and of `others`, were recorded with different settings."""
    different = findings.differences([*others, *found])
    if different and different != findings.differences(others):
        warn(different, GroundNote)


def note_suspicions(found: Sequence[Recording], model: Model) -> None:
    """Warns of mistakes that recordings of a model's craft look like."""
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
        "length of the windows over which errors are taken [s] (1.5 times that in which full thrust moves "
        "the craft by some lengths or turns it round)",
        type=positive,
        metavar="S",
    )

    def of(self, run: RepairedRun, model: Model) -> _core.RunData:
        """_core.RunData of that part of a run. GroundError when nothing is left of it."""
        return run.data(model.core, self.start, self.end, self.everything, self.window)


@dataclass(frozen=True)
class Measured:
    """Recordings as fits use them."""

    recordings: List[Recording]
    data: List[_core.RunData]
    findings: List[suspicions.Suspicion]  #: mistakes that the recordings look like

    @property
    def runs(self) -> List[RepairedRun]:
        """The recordings with their motion repaired."""
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
    """Recordings to fit to or to test on; work: told of what is done. Warns of possible errors of a
    recording's repair, and of settings that differ among these and `others`. GroundError when a
    recording cannot be used.
    """
    if not model.core.input_max > 0:
        raise GroundError("the model's input_max is not positive")
    found = [recording.with_lift_of(model.core) for recording in taken(given)]
    if not found:
        raise GroundError(NO_RECORDING)
    note_differences(found, others)
    runs = repaired(found, work, model.core)
    doubts = suspicions.about(found, model.core)
    for d in findings.with_suspicions([findings.described(run) for run in runs], doubts):
        for finding in findings.grave(d):
            warn("%s: %s" % (d["name"], finding))
    for one in doubts:
        if len(one.runs) > 1:
            warn(one.sentence)
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
                "a run is given both for the fit and as holdout: %s" % _both(known[one.identity], one)
            )
    return measured(distinct(found, fitted.recordings), model, part, work, fitted.recordings)
