"""Saved diagnoses: which version of the package made their verdicts, and whether these would change."""

import json
import os
from typing import Dict, List, Optional, Sequence

from ground import _core
from ground.reading import readers
from ground.reading.mapping import FieldMapping
from ground.support.annotations import Document
from ground.support.errors import GroundError, sentence
from ground.support.progress import Work
from ground.support.public import public

SCHEMA = "ground/diagnosis/"  # begin of the schema's name
AGAIN = "diagnosing again"  # stage


def read(paths: Sequence[str]) -> List[Document]:
    """What diagnosis.json files say: folder, verdict, effects, version (None: made by a version that did not
    say it), and whether this one is another. Files of another kind are left out."""
    found = []
    for path in paths:
        try:
            with open(path) as file:
                report = json.load(file)
            if not report["schema"].startswith(SCHEMA):
                continue
            version = report.get("version")
            known = {
                "folder": os.path.dirname(path),
                "verdict": report["verdict"],
                "effects": report["improved"]["effects"],
                "version": version,
                "current": version == _core.version,
                "now": None,
            }
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            continue
        found.append(known)
    return found


def again(
    found: Sequence[Document], runs: Sequence[str], mapping: FieldMapping, work: Work
) -> List[Document]:
    """The same with what this version of the package says of those that another one made (`now`: verdict,
    effects, changed; or why it cannot say so). runs: paths of the recordings that are known."""
    stale = [one for one in found if not one["current"]]
    by_name: Dict[str, List[str]] = {}
    for path in runs:
        by_name.setdefault(os.path.splitext(os.path.basename(path))[0], []).append(path)
    with work.stage(AGAIN, len(stale)):
        for one in work.each(stale):
            one["now"] = _again(one, by_name, mapping)
    return list(found)


def _again(one: Document, runs: Dict[str, List[str]], mapping: FieldMapping) -> Document:
    with open(os.path.join(one["folder"], "diagnosis.json")) as file:
        report = json.load(file)
    model, used = report["model"], report["runs"]
    if not os.path.isfile(model):
        return _cannot("its model %s is not there" % model)
    held = [] if report["improved"]["error"]["by"] != "holdout" else used["heldout"]
    missing = [name for name in [*used["fit"], *held] if len(runs.get(name, [])) != 1]
    if missing:
        return _cannot("not exactly one of the runs is named %s" % ", ".join(missing))
    try:
        fitted, tested = ([readers.read(runs[n][0], mapping) for n in names] for names in (used["fit"], held))
        now = public("diagnose")(model, fitted, holdout=tested)
    except GroundError as error:
        return _cannot(sentence(error))
    changed = now.verdict != one["verdict"] or sorted(now.effects) != sorted(one["effects"])
    return {"verdict": now.verdict, "effects": list(now.effects), "changed": changed, "why": None}


def _cannot(why: Optional[str]) -> Document:
    return {"verdict": None, "effects": [], "changed": None, "why": why}
