"""Saved diagnoses: which version of the package made their verdicts, and whether these would change."""

import json
import os
from dataclasses import dataclass, replace
from typing import Dict, List, Optional, Sequence

from ground import _core
from ground.reading import readers
from ground.reading.mapping import FieldMapping
from ground.support.errors import GroundError, sentence
from ground.support.progress import Work
from ground.support.public import public

SCHEMA = "ground/diagnosis/"  # begin of the schema's name
AGAIN = "diagnosing again"  # stage


@dataclass(frozen=True)
class RepeatedVerdict:
    """What this version of the package says of a saved diagnosis."""

    verdict: Optional[str]
    effects: List[str]
    changed: Optional[bool]
    why: Optional[str]  #: it cannot be repeated


@dataclass(frozen=True)
class SavedVerdict:
    """The verdict of a saved diagnosis."""

    folder: str
    verdict: str
    effects: List[str]
    version: Optional[str]  #: of the package that made it; None: not stated
    current: bool  #: whether it is this one
    now: Optional[RepeatedVerdict]  #: None: not repeated


def read(paths: Sequence[str]) -> List[SavedVerdict]:
    """What diagnosis.json files say. Files of another kind are left out."""
    found = []
    for path in paths:
        try:
            with open(path) as file:
                report = json.load(file)
            if not report["schema"].startswith(SCHEMA):
                continue
            version, effects = report.get("version"), report["improved"]["effects"]
            is_current = version == _core.version
            found.append(
                SavedVerdict(os.path.dirname(path), report["verdict"], effects, version, is_current, None)
            )
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            continue
    return found


def again(
    found: Sequence[SavedVerdict], runs: Sequence[str], mapping: FieldMapping, work: Work
) -> List[SavedVerdict]:
    """The same with what this version of the package says of diagnoses that another one made. runs: paths of
    the recordings that are known."""
    by_name: Dict[str, List[str]] = {}
    for path in runs:
        by_name.setdefault(os.path.splitext(os.path.basename(path))[0], []).append(path)
    stale = [one for one in found if not one.current]
    with work.stage(AGAIN, len(stale)):
        repeated = {one.folder: _again(one, by_name, mapping) for one in work.each(stale)}
    return [repeated.get(one.folder, one) for one in found]


def _again(one: SavedVerdict, runs: Dict[str, List[str]], mapping: FieldMapping) -> SavedVerdict:
    with open(os.path.join(one.folder, "diagnosis.json")) as file:
        report = json.load(file)
    model, used = report["model"], report["runs"]
    if not os.path.isfile(model):
        return _cannot(one, "its model %s no longer exists" % model)
    held = [] if report["improved"]["error"]["by"] != "holdout" else used["heldout"]
    missing = [name for name in [*used["fit"], *held] if len(runs.get(name, [])) != 1]
    if missing:
        return _cannot(one, "not exactly one of the runs is named %s" % ", ".join(missing))
    try:
        fitted, tested = ([readers.read(runs[n][0], mapping) for n in names] for names in (used["fit"], held))
        now = public("diagnose")(model, fitted, holdout=tested)
    except GroundError as error:
        return _cannot(one, sentence(error))
    changed = now.verdict != one.verdict or sorted(now.effects) != sorted(one.effects)
    return replace(one, now=RepeatedVerdict(now.verdict, list(now.effects), changed, None))


def _cannot(one: SavedVerdict, why: str) -> SavedVerdict:
    return replace(one, now=RepeatedVerdict(None, [], None, why))
