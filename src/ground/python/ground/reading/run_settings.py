"""How a run was recorded and flown: settings of the mocap, parameters, model and room, live changes.

mocap_state publishes its settings latched, so that every part of a split recording begins with them.
record.launch writes parameters beside a bag, as RUN.yaml; the bag of a simulated run has the same text in a
message (ground_msgs/RunSettings). The contents of the files that they name are under run_files, path: text.
"""

import contextlib
import hashlib
import itertools
import math
import os
import re
from dataclasses import dataclass, field, replace
from typing import Dict, Iterable, Iterator, List, Mapping, Optional, Tuple, Union

import numpy as np
import yaml

from ground import _core
from ground.reading.containers import STAMP, Container, seconds
from ground.reading.mapping import FieldMapping
from ground.support import files
from ground.support.annotations import Indices
from ground.support.bounded_yaml import LOADER
from ground.support.errors import GroundError, reason

AXES = "x, z, -y"  # default of mocap_state, for OptiTrack with y up
FILES = "run_files"
NAMES = ("model", "room")  # parameters whose files' contents are recorded
LARGEST = 10**6  # size of the largest file that is recorded [bytes]
PART = re.compile(r"(_\d+)?\.bag(\.active)?$")  # end of the name of a part of a recording
# name here -> parameter of node controller
FLOWN_BY = {"controller": "kind", **{name: name for name in ("design", "reference", "model", "room")}}


@dataclass(frozen=True)
class Setting:
    """One way to turn poses of the mocap into world_ned."""

    since: int  # it applies to poses stamped after this [ns]
    axes: str  # world_ned x, y, z in the mocap's axes
    heading_offset: float  # measured minus true heading [rad]

    @property
    def vertical(self) -> int:
        """Which of the mocap's axes, 0 to 2, is vertical."""
        return "xyz".index(self.axes.strip()[-1])

    def mapping(self, source: str) -> _core.AxisMapping:
        """The _core.AxisMapping; for an invalid setting GroundError names `source`."""
        if not abs(self.heading_offset) <= 2 * math.pi:
            raise GroundError(
                "%s: heading_offset %g is out of range; write it in radians, from -6.28 to 6.28"
                % (source, self.heading_offset)
            )
        try:
            return _core.AxisMapping(self.axes, self.heading_offset)
        except ValueError as error:
            raise GroundError("%s: %s" % (source, error))


@dataclass(frozen=True)
class Settings:
    """The settings of a run, in order of time; the first one also applies to all poses before."""

    changes: Tuple[Setting, ...] = (Setting(0, AXES, 0.0),)
    #: sources of axes and heading_offset, in words
    sources: Mapping[str, str] = field(
        default_factory=lambda: {"axes": "default", "heading_offset": "default"}
    )
    taken: Tuple[str, ...] = ()  # which of them the poses of the run need

    def parts(self, stamps: Indices) -> Iterator[Tuple[Setting, _core.AxisMapping, Indices]]:
        """Each setting with the places of the poses that it is for; stamps (n,) [ns]."""
        sinces = [change.since for change in self.changes]
        which = np.maximum(np.searchsorted(sinces, stamps, side="left") - 1, 0)
        for number in np.unique(which):
            change = self.changes[number]
            yield change, change.mapping(self.sources["axes"]), np.flatnonzero(which == number)

    def values(self, name: str) -> Optional[Tuple[Union[str, float], ...]]:
        """Values of axes or heading_offset in order of time; None if the poses do not need it."""
        if name not in self.taken:
            return None
        return tuple(value for value, _ in itertools.groupby(getattr(s, name) for s in self.changes))

    def describe(self, zero: float) -> Dict[str, object]:
        """The settings as plain values; times are those since `zero` [s]."""
        return {
            "axes": self.changes[0].axes,
            "heading_offset": self.changes[0].heading_offset,
            "sources": dict(self.sources),
            "taken": list(self.taken),
            "changes": [
                {"time": 1e-9 * s.since - zero, "axes": s.axes, "heading_offset": s.heading_offset}
                for s in self.changes[1:]
            ],
        }


def settings_of(
    bag: Container, taken: Tuple[str, ...], mapping: FieldMapping, warnings: List[str]
) -> Settings:
    """The Settings of poses in a Container; taken: which of them the poses take.

    The mapping gives them, else the bag, else the parameter file beside it, else the defaults. Adds to
    `warnings` what could not be read and what the poses do not need; raises GroundError for axes that
    are not a frame.
    """
    axes, offset = mapping.poses.axes, mapping.poses.heading_offset
    changes, source = _in_bag(bag, warnings), "recorded in the bag"
    if not changes:
        changes, source = _beside(bag.path, warnings)
    sources = {"axes": source, "heading_offset": source}
    for name, value in (("axes", axes), ("heading_offset", offset)):
        if value is None:
            continue
        option = mapping.sources.get(name, name)
        Setting(0, axes or AXES, offset or 0.0).mapping(option)
        if name in taken:
            changes = [replace(s, **{name: value}) for s in changes]
            sources[name] = option
        else:
            has = "planar poses" if taken else "states, corrected when it was recorded"
            warnings.append("%s changes nothing: the bag contains %s" % (option, has))
    kept: List[Setting] = []
    for s in changes:  # every part of a split recording repeats the last one
        if not kept or (s.axes, s.heading_offset) != (kept[-1].axes, kept[-1].heading_offset):
            s.mapping(sources["axes"])
            kept.append(s)
    return Settings(tuple(kept), sources, taken)


def _in_bag(bag: Container, warnings: List[str]) -> List[Setting]:
    kind = "ground_msgs/MocapSettings"
    topics = bag.of_kind(kind)
    if not topics and any(topic.kind == kind for topic in bag.topics.values()):
        warnings.append("the mocap settings recorded in the bag are lost")
    if len(topics) > 1:
        raise GroundError(
            "%s: several topics could be the settings of the mocap: %s" % (bag.path, ", ".join(topics))
        )
    found = [Setting(m[STAMP], m["axes"], m["heading_offset"]) for m in bag.rows(kind)]
    return sorted(found, key=lambda s: s.since)


def _beside(path: str, warnings: List[str]) -> Tuple[List[Setting], str]:
    """Settings from the parameter file beside a bag, a list of one, and their source."""
    for name, parameters in beside(path, warnings):
        for node in nodes(parameters, "mocap_state"):
            axes, offset = node.get("axes", AXES), node.get("heading_offset", 0.0)
            if isinstance(axes, str) and isinstance(offset, (int, float)):
                return [Setting(0, axes, float(offset))], "recorded in %s" % os.path.basename(name)
    return [Setting(0, AXES, 0.0)], "default"


def beside(path: str, warnings: List[str]) -> Iterator[Tuple[str, object]]:
    """Name and content of the readable parameter files beside a bag."""
    names = PART.sub("", path) + ".yaml", os.path.splitext(path)[0] + ".yaml"
    for name in filter(os.path.isfile, dict.fromkeys(names)):
        try:
            with open(name) as file:
                yield name, yaml.load(file, LOADER)
        except (OSError, ValueError, yaml.YAMLError, RecursionError) as error:
            warnings.append(
                "%s: cannot be read, so that axes and heading_offset are the defaults (%s)"
                % (os.path.basename(name), str(error).splitlines()[0])
            )


def nodes(parameters: object, name: str) -> Iterator[Dict[str, object]]:
    """Parameters of nodes of that name, in any namespace."""
    for key, value in parameters.items() if isinstance(parameters, dict) else ():
        if key == name and isinstance(value, dict):
            yield value
        else:
            yield from nodes(value, name)


def contents(parameters: object) -> str:
    """YAML text with the contents of the model and room files that `parameters` (a dict by node) name;
    files that cannot be read are left out."""
    named = {value for path, value in _flat(parameters, "") if path.rsplit(".", 1)[-1] in NAMES}
    texts = ((path, _content(path)) for path in sorted(one for one in named if isinstance(one, str)))
    found = {path: text for path, text in texts if text and len(text) <= LARGEST}
    return str(yaml.safe_dump({FILES: found}) if found else "")


def document(parameters: object) -> str:
    """YAML text of parameters by node, with the contents of their files."""
    return str(yaml.safe_dump(parameters) + contents(parameters))


def _content(path: str) -> Optional[str]:
    with contextlib.suppress(OSError, ValueError):
        if os.path.isfile(path):
            with open(path, encoding="utf-8") as file:
                return file.read(LARGEST + 1)
    return None


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

    def entries(self) -> Dict[str, object]:
        """Its entries by path, {"body.m": 0.0583}, without provenance and comments."""
        try:
            content = yaml.load(self.text, LOADER)
        except (ValueError, yaml.YAMLError, RecursionError):
            return {"text": self.text}
        return {key: value for key, value in _flat(content, "") if key.split(".")[0] != "provenance"}

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
        try:
            os.makedirs(os.path.dirname(path), exist_ok=True)
            files.write_text(path, self.text, force=True)
        except OSError as error:
            raise GroundError("%s: cannot be written (%s)" % (path, reason(error)))
        return path


def _flat(value: object, path: str) -> Iterator[Tuple[str, object]]:
    """Path and value of all entries in nested maps and lists of maps."""
    inside: Iterable[Tuple[object, object]]
    if isinstance(value, dict):
        inside = value.items()
    elif isinstance(value, list) and any(isinstance(inner, dict) for inner in value):
        inside = enumerate(value, 1)
    else:
        yield path, value
        return
    for key, inner in inside:
        yield from _flat(inner, "%s.%s" % (path, key) if path else str(key))


def flown_by(bag: Container) -> Tuple[Dict[str, str], Dict[str, RunFile]]:
    """How the craft was flown: `controller`, `design` or `reference` and the names of the files `model` and
    `room`, each if known; and the RunFile of `model` and `room` if their contents were recorded, and of
    `truth`, the model of a simulated craft."""
    known: List[object] = []
    for message in bag.rows("ground_msgs/RunSettings"):
        with contextlib.suppress(ValueError, yaml.YAMLError, RecursionError):
            known.append(yaml.load(message["yaml"], LOADER))
    known += [parameters for _, parameters in beside(bag.path, [])]
    found: Dict[str, str] = {}
    kept: Dict[str, RunFile] = {}
    for parameters in known:
        recorded = parameters.get(FILES) if isinstance(parameters, dict) else None
        texts = recorded if isinstance(recorded, dict) else {}
        for node, (name, key) in itertools.product(nodes(parameters, "controller"), FLOWN_BY.items()):
            value = node.get(key)
            if name in found or not isinstance(value, str) or not value:
                continue
            found[name] = os.path.basename(value) if name in NAMES else value
            if name in NAMES and isinstance(texts.get(value), str):
                kept[name] = RunFile(value, texts[value])
        for path in (str(node.get("model", "")) for node in nodes(parameters, "simulator")):
            if isinstance(texts.get(path), str):
                kept.setdefault("truth", RunFile(path, texts[path]))
    return found, kept


@dataclass(frozen=True)
class LiveChange:
    """A change that a node accepted while it ran."""

    time: float  # stamp [s]
    node: str
    name: str  # parameter's name; model or model2 for a model file
    before: str
    after: str

    def describe(self, zero: float) -> Dict[str, object]:
        """The change as plain values; its time counts from `zero` [s]."""
        return dict(vars(self), time=self.time - zero)


def live_changes(bag: Container) -> List[LiveChange]:
    """The LiveChanges in a Container, in order of time."""
    found = [
        LiveChange(float(seconds(np.array(m[STAMP]))), m["node"], m["name"], m["before"], m["after"])
        for m in bag.rows("ground_msgs/LiveChange")
    ]
    return sorted(found, key=lambda change: change.time)
