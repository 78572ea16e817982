"""Recordings without a mapping: read by a draft, where the file and the motion leave no doubt about it."""

import os
import tempfile
from dataclasses import replace
from typing import List

from ground.checks import layouts, suspicions
from ground.draft import drafts, undecided
from ground.reading import readers, recorded_files
from ground.reading.mapping import FieldMapping, load
from ground.reading.recording import Recording
from ground.support import files
from ground.support.errors import POINT, GroundError

DRAFTS = "--write-mapping"  # in errors that a mapping mends
# instead of a mapping, where a column is named %time
ECHOED = (
    "tables of `rostopic echo -p` need none: identify import CONTROLS.csv POSE.csv -o RUN.bag reads a pair"
)
MAX_NAMED = 9  # lines to decide that an error has; the rest is counted


def read(path: str, given: FieldMapping, why: GroundError) -> List[Recording]:
    """The recordings at a path, each with the drafted `mapping` that it was read by.

    given: what options say; why: the error of reading it without a mapping. GroundError `why`, with the lines
    to decide, where the draft has something that neither the file nor the motion decides.
    """
    options = FieldMapping(noise=given.noise, frame_rate=given.frame_rate, types=given.types)
    if DRAFTS not in str(why) or given != options or recorded_files.to_draft(path) != path:
        raise why
    try:
        with readers.opened(path, given.types) as source:
            text = drafts.draft(source, os.path.isdir(path), [os.path.abspath(one) for one in given.types])
    except GroundError:
        raise why
    left = undecided.lines(text)
    tried = [_read(path, way, options) for way in undecided.either_way_up(text)]
    found = [runs for runs in tried if runs and all(_fits(run, is_complete=not left) for run in runs)]
    if len(found) == 1 and (found[0] is tried[0] or not undecided.is_height_clear(text)):
        return found[0]
    doubts = [[one for run in runs for one in _misread(run)] for runs in tried]
    # Of a frame that is left to decide, one way is wrong: that says nothing unless the other one is, too.
    is_refuted = all(any(one.kind in layouts.GRAVEST for one in own) for own in doubts)
    for own in doubts[:1]:
        left += [one.sentence for one in own if is_refuted or one.kind not in layouts.GRAVEST]
    if not left:
        raise why
    left = [ECHOED] * ('"%time"' in text) + left
    more = ["and %d more" % (len(left) - MAX_NAMED)] if len(left) > MAX_NAMED else []
    raise GroundError(POINT.join(["%s; to decide in it:" % why, *left[:MAX_NAMED], *more]))


def _read(path: str, text: str, options: FieldMapping) -> List[Recording]:
    """The recordings at a path by the text of a mapping; none where they cannot be read so."""
    with tempfile.TemporaryDirectory() as folder:
        file = os.path.join(folder, "drafted.yaml")
        files.write_text(file, text)
        try:
            mapping = load(file).with_options(noise=options.noise, frame_rate=options.frame_rate)
            mapping = replace(mapping, file="drafted", sources=dict.fromkeys(mapping.sources, "drafted"))
            runs = [readers.read(one, mapping) for one in recorded_files.listed([path], mapping)]
        except GroundError:
            return []
    return [replace(run, mapping=text) for run in runs]


def _misread(run: Recording) -> List[suspicions.Suspicion]:
    """What the motion says against units, clocks, channels and frame of a run."""
    found = suspicions.about([run], None)
    return [one for one in found if one.misread or one.kind in layouts.GRAVEST]


def _fits(run: Recording, is_complete: bool) -> bool:
    """Whether the motion does not refute a run's channels and frame; where the draft is not complete, whether
    it refutes every other way to read them. Only what left and right do is known without a model."""
    thrusters = suspicions.judged_by([run], None)
    verdict = suspicions.alone(run, thrusters) if thrusters else None
    is_decided = verdict is not None and verdict.is_as_recorded and not verdict.undecided
    return (is_complete or is_decided) and not _misread(run)
