"""Reads and repairs recordings, several side by side in processes where that is worth it."""

import functools
import os
from typing import Any, Callable, Iterator, Sequence

from ground.recordings import quality, readers
from ground.recordings.mapping import FieldMapping
from ground.recordings.recording import Recording
from ground.workers import Workers

WORTH_READING = 3e6  # size of recordings from which several processes read them sooner [bytes]
WORTH_REPAIRING = 2e4  # the same for repairs [poses]

TellOne = Callable[[int, float], None]  # called with the number of a recording and the share of it


def read(paths: Sequence[str], mapping: FieldMapping, tell: TellOne) -> Iterator[Recording]:
    """The recordings at paths, one by one. tell: called with what has been read of one. Raises
    GroundError."""
    if _alone(len(paths), sum(map(readers.size, paths)), WORTH_READING):
        for number, path in enumerate(paths):
            yield readers.read(path, mapping, functools.partial(tell, number))
    else:
        with Workers(processes=True) as team:
            yield from team.map(functools.partial(_read, mapping), paths)


def repair(recordings: Sequence[Recording]) -> Iterator[quality.Run]:
    """The runs of recordings, one by one, which become their `repaired`. Raises GroundError."""
    missing = [r for r in recordings if "repaired" not in vars(r)]
    if not _alone(len(missing), sum(len(r.eta) for r in missing), WORTH_REPAIRING):
        with Workers(processes=True) as team:
            for recording, found in zip(missing, team.map(_repair, missing)):
                vars(recording)["repaired"] = quality.Run.restored(recording, **found)
    for recording in recordings:
        yield recording.repaired


def _alone(count: int, size: float, worth: float) -> bool:
    """Whether one process does it as soon as several."""
    return count < 2 or size < worth or len(os.sched_getaffinity(0)) < 2


def _read(mapping: FieldMapping, path: str) -> Recording:
    return readers.read(path, mapping)


def _repair(recording: Recording) -> Any:
    """What is known of the run of a recording."""
    found = dict(vars(quality.Run(recording)))
    del found["recording"]
    return found
