"""Reads and repairs recordings through their cache, several side by side in processes."""

import contextlib
import os
from typing import Callable, Iterable, Iterator, List, Optional, Sequence, Tuple

from ground.errors import GroundError
from ground.recordings import cache, columns, quality, readers
from ground.recordings.columns import Columns
from ground.recordings.mapping import FieldMapping
from ground.recordings.messages import Tell
from ground.recordings.recording import Recording
from ground.workers import Workers

WORTH_READING = 3e6  # size of recordings from which several processes read them sooner [bytes]
WORTH_REPAIRING = 2e4  # the same for repairs [poses]

TellOne = Callable[[int, float], None]  # called with the number of a recording and the share of it
Files = List[Tuple[str, int, int]]  # path, size [bytes], time of change [ns]
Reading = Tuple[str, FieldMapping, str]  # path, mapping, folder of the cache
Repair = Tuple[Columns, str, str]  # Columns of a recording, its path, folder of the cache


def read(
    paths: Sequence[str], mapping: FieldMapping, cached: bool, tell: TellOne
) -> Iterator[Recording]:
    """The recordings at paths, one by one. cached: whether the cache is used; tell: called with what has
    been read of one. Raises GroundError."""
    tasks = [(path, mapping, cache.folder_of(path) if cached else "") for path in paths]
    with contextlib.ExitStack() as stack:
        found: Iterable[Columns]
        if _alone(len(tasks), sum(map(readers.size, paths)), WORTH_READING):
            found = (_read(task, _teller(tell, number)) for number, task in enumerate(tasks))
        else:
            found = stack.enter_context(Workers(processes=True)).map(_read, tasks)
        for (path, _, folder), given in zip(tasks, found):
            yield columns.recording_of(given, path, folder)


def repair(recordings: Sequence[Recording]) -> Iterator[quality.Run]:
    """The runs of recordings, one by one, which become their `repaired`. Raises GroundError."""
    missing = [r for r in recordings if "repaired" not in vars(r)]
    tasks = ((columns.of_recording(r), r.path, r.cache) for r in missing)
    with contextlib.ExitStack() as stack:
        found: Iterator[Columns]
        if _alone(len(missing), sum(len(r.eta) for r in missing), WORTH_REPAIRING):
            found = map(_repair, tasks)
        else:
            found = stack.enter_context(Workers(processes=True)).map(_repair, tasks)
        for recording in recordings:
            if "repaired" not in vars(recording):
                vars(recording)["repaired"] = columns.run_of(next(found), recording)
            yield recording.repaired


def _alone(count: int, size: float, worth: float) -> bool:
    """Whether one process does it as soon as several."""
    return count < 2 or size < worth or len(os.sched_getaffinity(0)) < 2


def _teller(tell: TellOne, number: int) -> Tell:
    return lambda share: tell(number, share)


def _read(task: Reading, tell: Optional[Tell] = None) -> Columns:
    """The Columns of a recording, from its cache or else from its files."""
    path, mapping, folder = task
    before = _state(path, mapping) if folder else []
    key = _key(before, path, mapping)
    found = _recalled(folder, path, cache.READING, key, lambda c: columns.recording_of(c, path))
    if found is None:
        found = columns.of_recording(readers.read(path, mapping, tell))
        if key and _state(path, mapping) == before:  # else something writes it
            cache.save(folder, path, cache.READING, key, found)
    return found


def _repair(task: Repair) -> Columns:
    """The Columns of a recording's run, from its cache or else by repairing it."""
    given, path, folder = task
    recording = columns.recording_of(given, path)
    key = cache.key_of_columns(given) if folder else ""
    found = _recalled(folder, path, cache.REPAIR, key, lambda c: columns.run_of(c, recording))
    if found is None:
        found = columns.of_run(quality.Run(recording))
        if key:
            cache.save(folder, path, cache.REPAIR, key, found)
    return found


def _recalled(
    folder: str, path: str, stage: str, key: str, use: Callable[[Columns], object]
) -> Optional[Columns]:
    """The entry of a cache, if there is one that can be used."""
    found = cache.load(folder, path, stage, key) if key else None
    if found is not None:
        try:
            use(found)
        except Exception:  # what is missing or of another type raises errors of many kinds
            return None
    return found


def _state(path: str, mapping: FieldMapping) -> Files:
    """The files that a recording is read from, as they are now; empty where that is not known."""
    with contextlib.suppress(OSError, GroundError):
        states = [(name, os.stat(name)) for name in readers.files(path, mapping)]
        return [(name, status.st_size, status.st_mtime_ns) for name, status in states]
    return []


def _key(files: Files, path: str, mapping: FieldMapping) -> str:
    """The key of a recording; empty where there is none."""
    with contextlib.suppress(OSError):
        if files:
            names = [name for name, _, _ in files]
            return cache.key_of_files(names, os.path.basename(path), repr(mapping))
    return ""
