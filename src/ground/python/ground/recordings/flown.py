"""How a run was flown: its controller, model and room, with the contents of the files if recorded."""

import hashlib
import json
import os
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Dict, Iterator, List, Mapping, Optional, Sequence, Tuple

import yaml

from ground import files
from ground.errors import GroundError, reason
from ground.recordings import run_parameters
from ground.recordings.messages import MessageSource

if TYPE_CHECKING:
    from ground.recordings.recording import Recording

# name here -> parameter of node controller
FLOWN_BY = {
    "controller": "kind",
    "design": "design",
    "reference": "reference",
    "model": "model",
    "room": "room",
}
IGNORED = ("provenance",)  # keys of files that do not describe the craft or the room
MAX_NAMED = 3  # listed entries in which two files differ


@dataclass(frozen=True)
class RunFile:
    """A model or room file as it was when the run was recorded."""

    path: str  # where it was
    text: str

    @property
    def name(self) -> str:
        """The file's name without its folder."""
        return os.path.basename(self.path)

    @property
    def digest(self) -> str:
        """SHA-256 of the text, in hexadecimal digits."""
        return hashlib.sha256(self.text.encode()).hexdigest()

    def entries(self) -> Dict[str, Any]:
        """Its entries by path, {"body.m": 0.0583}, without provenance and comments."""
        try:
            content = yaml.load(self.text, run_parameters.LOADER)
        except (ValueError, yaml.YAMLError, RecursionError):
            return {"text": self.text}
        return {key: value for key, value in _flat(content, "") if key.split(".")[0] not in IGNORED}

    def describe(self) -> Dict[str, str]:
        """Path, title and SHA-256, as plain values."""
        title = self.entries().get("name", self.name)
        return {"path": self.path, "title": str(title), "sha256": self.digest}

    def place(self) -> str:
        """Path of a file with this content: the original if it has not changed, else a copy under
        $ROS_HOME/ground. Raises GroundError when that cannot be written."""
        if _content(self.path) == self.text:
            return os.path.abspath(self.path)
        home = os.environ.get("ROS_HOME") or os.path.expanduser("~/.ros")
        path = os.path.join(home, "ground", "run_files", self.digest[:16], self.name)
        if _content(path) == self.text:
            return path
        folder = os.path.dirname(path)
        try:
            os.makedirs(folder, exist_ok=True)
            temporary = files.temporary_file(folder)
            with open(temporary, "w") as file:
                file.write(self.text)
            os.replace(temporary, path)
        except OSError as error:
            raise GroundError("%s: cannot be written (%s)" % (path, reason(error)))
        return path


def _content(path: str) -> Optional[str]:
    try:
        if os.path.isfile(path):
            with open(path, encoding="utf-8") as file:
                return file.read(run_parameters.LARGEST + 1)
    except (OSError, ValueError):
        pass
    return None


def _flat(value: Any, path: str) -> Iterator[Tuple[str, Any]]:
    """Path and value of all entries in nested maps and lists of maps."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _flat(inner, "%s.%s" % (path, key) if path else str(key))
    elif isinstance(value, list) and any(isinstance(inner, dict) for inner in value):
        for number, inner in enumerate(value, 1):
            yield from _flat(inner, "%s.%d" % (path, number))
    else:
        yield path, value


def read(path: str, bag: MessageSource) -> Tuple[Dict[str, str], Dict[str, RunFile]]:
    """How the craft was flown in the bag at `path`, open in the MessageSource `bag`: `controller`,
    `design` or `reference` and the names of the files `model` and `room`, each if known; and the
    RunFile of `model` and `room` if their contents were recorded."""
    found, kept = {}, {}
    known = list(run_parameters.in_bag(bag))
    known += [parameters for _, parameters in run_parameters.beside(path, [])]
    for parameters in known:
        for node in run_parameters.nodes(parameters, "controller"):
            for name, key in FLOWN_BY.items():
                value = node.get(key)
                if name in found or not isinstance(value, str) or not value:
                    continue
                found[name] = value
                if name in run_parameters.NAMES:
                    found[name] = os.path.basename(value)
                    files = parameters.get(run_parameters.FILES)
                    text = files.get(value) if isinstance(files, dict) else None
                    if isinstance(text, str):
                        kept[name] = RunFile(value, text)
    return found, kept


def differences(recordings: Sequence["Recording"]) -> List[str]:
    """Phrases that group recordings by model and room of their controllers where these differ: by
    content if that was recorded, else by name."""
    parts = []
    for kind in run_parameters.NAMES:
        groups = _groups(recordings, kind)
        if len(groups) < 2:
            continue
        parts += ["%s %s for %s" % (kind, name, ", ".join(r)) for name, _, r in groups]
        (first, one, _), others = groups[0], groups[1:]
        for name, another, _ in others:
            if one is not None and another is not None:
                pair = "two files named %s differ" % first
                if name != first:
                    pair = "%s and %s differ" % (first, name)
                parts.append("%s: %s" % (pair, _changes(one, another)))
    return parts


def _groups(
    recordings: Sequence["Recording"], kind: str
) -> List[Tuple[str, Optional[Dict[str, Any]], List[str]]]:
    """(name, entries or None, names of the recordings) of those that were flown by the same file."""
    groups: Dict[str, Tuple[str, Optional[Dict[str, Any]], List[str]]] = {}
    ordered = sorted(recordings, key=lambda r: kind not in r.files)
    for recording in ordered:
        name = recording.flown_by.get(kind)
        if name is None:
            continue
        file = recording.files.get(kind)
        if file is not None:
            entries = file.entries()
            key = json.dumps(entries, sort_keys=True, default=str)
        else:
            entries = None
            key = next((k for k, group in groups.items() if group[0] == name), name)
        groups.setdefault(key, (name, entries, []))[2].append(recording.name)
    return list(groups.values())


def _changes(one: Mapping[str, Any], another: Mapping[str, Any]) -> str:
    """Differences between the entries of two files, in words."""
    missing = "none"
    keys = [
        key
        for key in dict.fromkeys([*one, *another])
        if one.get(key, missing) != another.get(key, missing)
    ]
    named = [
        "%s %s against %s" % (key, one.get(key, missing), another.get(key, missing))
        for key in keys[:MAX_NAMED]
    ]
    if len(keys) > MAX_NAMED:
        named.append("and %d more" % (len(keys) - MAX_NAMED))
    return ", ".join(named)
