"""Runs below folders: where they are, when they were recorded, and which craft flew."""

import os
import re
from dataclasses import dataclass
from datetime import datetime
from typing import Dict, Iterator, List, Optional, Sequence, Tuple

from ground.reading import recorded_files
from ground.reading.instants import CENTURY
from ground.reading.mapping import FieldMapping
from ground.support.errors import GroundError, OptionError

DATE = re.compile(
    r"(?<!\d)((?:19|20)\d\d)[-_.]?(\d\d)[-_.]?(\d\d)"
    r"(?:[-_T. ]?([01]\d|2[0-3])[-_.:h]?(\d\d)(?:[-_.:m]?(\d\d))?)?(?!\d)"
)
STAMPS, NAME, FILE = "stamps", "name", "file"  # where a time is from: messages, a path, the file system
BY_MODEL, BY_FOLDER, BY_PATTERN = "model", "folder", "pattern"  # how crafts are distinguished
ONLY = "craft"  # name of a craft of which nothing is known
DIAGNOSIS = "diagnosis.json"


@dataclass(frozen=True)
class Place:
    """A recorded run below a folder."""

    path: str
    folder: str  #: that was given

    @property
    def name(self) -> str:
        """Its file's or folder's name without the extension."""
        return os.path.splitext(os.path.basename(os.path.abspath(self.path)))[0]

    @property
    def below(self) -> str:
        """Its path below the folder."""
        return os.path.relpath(self.path, self.folder)


def find(folders: Sequence[str], mapping: FieldMapping) -> Tuple[List[Place], List[str]]:
    """All recordings that the verbs read, and all diagnosis.json, below folders (or the files themselves).
    Tables count with a mapping that says which columns are times. GroundError without any run."""
    found: Dict[str, Place] = {}
    diagnoses = []
    for given in folders:
        if not os.path.isdir(given):
            found.setdefault(os.path.realpath(given), Place(given, os.path.dirname(given) or os.curdir))
            continue
        for folder, below, names in os.walk(given):
            below[:] = sorted(name for name in below if not name.startswith("."))
            diagnoses += [os.path.join(folder, name) for name in names if name == DIAGNOSIS]
            for path in _recordings(folder, mapping):
                found.setdefault(os.path.realpath(path), Place(path, given))
    if not found:
        raise GroundError(
            "%s: contains no recorded runs; tables (CSV, Parquet) need --mapping" % ", ".join(folders)
        )
    return sorted(found.values(), key=lambda place: place.path), sorted(diagnoses)


def _recordings(folder: str, mapping: FieldMapping) -> Iterator[str]:
    """Recordings in a folder, tables only where the mapping is of tables."""
    try:
        listed = recorded_files.listed([folder], mapping, 0)
    except GroundError:
        return
    for path in listed:
        if mapping.of_tables or path != folder or recorded_files.is_bag(path):
            yield path


def recorded_at(place: Place, first_stamp: float) -> Tuple[datetime, str]:
    """When a run was recorded, local time, and where that is from: the stamps of its messages, the last date
    in its path, or, where there is none, the time at which its file was changed."""
    if first_stamp >= CENTURY:
        return datetime.fromtimestamp(first_stamp), STAMPS
    for date in reversed(list(DATE.finditer(place.below))):
        numbers = [int(part or 0) for part in date.groups()]
        try:
            return datetime(*numbers), NAME  # type: ignore[arg-type]
        except ValueError:  # digits that are no date
            continue
    return datetime.fromtimestamp(os.path.getmtime(place.path)), FILE


def crafts(
    places: Sequence[Place], models: Sequence[Optional[str]], how: Optional[str]
) -> Tuple[List[str], str]:
    """The craft of each run, and how it was found. models: names of the model files that the runs recorded.

    how: a level of folders below the given one ("1" is the first), a pattern of which the first group of
    its match in the path is the craft, or None: the recorded model, where all runs have one and either it
    differs or no folders tell more, else the first folder that is no date. OptionError for a pattern."""
    if how is not None:
        return _as_asked(places, how)
    folders = [next(iter(_folders(place)), "") for place in places]
    if all(models) and (len(set(models)) > 1 or len(set(folders)) < 2):
        return [os.path.splitext(str(model))[0] for model in models], BY_MODEL
    if any(folders):
        return [folder or ONLY for folder in folders], BY_FOLDER
    return [os.path.splitext(model)[0] if model else ONLY for model in models], BY_MODEL


def _as_asked(places: Sequence[Place], how: str) -> Tuple[List[str], str]:
    if how.isdigit() and int(how) > 0:
        parts = [place.below.split(os.sep)[:-1] for place in places]
        return [part[int(how) - 1] if len(part) >= int(how) else ONLY for part in parts], BY_FOLDER
    try:
        pattern = re.compile(how)
    except re.error as error:
        raise OptionError("{0}: {how!r} is no pattern ({why})", "craft", how=how, why=error)
    matches = [pattern.search(place.below) for place in places]
    if not any(matches):
        raise OptionError("{0}: {how!r} matches none of the {n} paths", "craft", how=how, n=len(places))
    return [(m.group(min(1, pattern.groups)) or ONLY) if m else ONLY for m in matches], BY_PATTERN


def _folders(place: Place) -> List[str]:
    """Names of folders of a run that are not dates."""
    return [name for name in place.below.split(os.sep)[:-1] if not DATE.search(name)]
