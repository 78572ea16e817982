"""Settings that turn poses of the mocap into world_ned: recorded with the run, or given by the user.

mocap_state publishes its settings latched, so that every part of a split recording begins with them;
the parameter file beside the bag has those with which the run began.
"""

import bisect
import math
import os
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Dict, Iterable, Iterator, List, Optional, Sequence, Tuple

import numpy as np

from ground import _core
from ground.annotations import Document, Indices, Time
from ground.errors import GroundError
from ground.recordings import flown, messages, run_parameters
from ground.recordings.mapping import FieldMapping
from ground.recordings.messages import MessageSource

if TYPE_CHECKING:
    from ground.recordings.recording import Recording

TYPE = "ground_msgs/MocapSettings"
AXES = "x, z, -y"  # default of mocap_state, for OptiTrack with y up


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


def _check(setting: Setting, source: str) -> _core.AxisMapping:
    """The _core.AxisMapping of a setting; for an invalid one GroundError names `source`."""
    if not abs(setting.heading_offset) <= 2 * math.pi:
        raise GroundError(
            "%s: heading_offset %g is out of range; write it in radians, from -6.28 to 6.28"
            % (source, setting.heading_offset)
        )
    try:
        return _core.AxisMapping(setting.axes, setting.heading_offset)
    except ValueError as error:
        raise GroundError("%s: %s" % (source, error))


@dataclass(frozen=True)
class Settings:
    """The settings of a run, in order of time; the first one also applies to all poses before."""

    changes: Tuple[Setting, ...]
    sources: Dict[str, str]  # sources of axes and heading_offset, in words
    taken: Tuple[str, ...]  # which of them the poses of the run need
    _mappings: List[_core.AxisMapping] = field(init=False, repr=False, compare=False)
    _sinces: List[int] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        mappings = [_check(s, self.sources["axes"]) for s in self.changes]
        object.__setattr__(self, "_mappings", mappings)
        object.__setattr__(self, "_sinces", [s.since for s in self.changes])

    def __reduce__(self) -> Tuple[Any, ...]:
        return Settings, (self.changes, self.sources, self.taken)  # mappings cannot be pickled

    def _index(self, stamp: Time) -> int:
        return max(0, bisect.bisect_left(self._sinces, stamp.to_nsec()) - 1)

    def mapping(self, stamp: Time) -> _core.AxisMapping:
        """The _core.AxisMapping of a pose stamped `stamp` (genpy.Time)."""
        return self._mappings[self._index(stamp)]

    def parts(self, stamps: Indices) -> Iterator[Tuple[_core.AxisMapping, Indices]]:
        """Each _core.AxisMapping with the places of the poses that it is for; stamps (n,) [ns]."""
        which = np.maximum(np.searchsorted(self._sinces, stamps, side="left") - 1, 0)
        for number in np.unique(which):
            yield self._mappings[number], np.flatnonzero(which == number)

    def vertical(self, stamp: Time) -> int:
        """Which of the mocap's axes, 0 to 2, is vertical for a pose stamped `stamp`."""
        return self.changes[self._index(stamp)].vertical

    def heading(self, stamp: Time, measured: float) -> float:
        """True heading [rad] of a measured one, for poses that are planar already."""
        offset = self.changes[self._index(stamp)].heading_offset
        return math.remainder(measured - offset, 2 * math.pi) if offset else measured

    def values(self, name: str) -> Optional[Tuple[Any, ...]]:
        """Values of axes or heading_offset in order of time; None if the poses do not need it."""
        values = [getattr(s, name) for s in self.changes]
        kept = [v for i, v in enumerate(values) if i == 0 or v != values[i - 1]]
        return tuple(kept) if name in self.taken else None

    def describe(self, zero: float) -> Document:
        """The settings as plain values; times are those since `zero` [s]."""
        return {
            "axes": self.changes[0].axes,
            "heading_offset": self.changes[0].heading_offset,
            "sources": self.sources,
            "taken": list(self.taken),
            "changes": [
                {
                    "time": 1e-9 * s.since - zero,
                    "axes": s.axes,
                    "heading_offset": s.heading_offset,
                }
                for s in self.changes[1:]
            ],
        }


def settings_of(
    bag: MessageSource,
    path: str,
    taken: Tuple[str, ...],
    mapping: FieldMapping,
    warnings: Optional[List[str]] = None,
) -> Settings:
    """The Settings of poses in the MessageSource at `path`; taken: which of them the poses take.

    They are those of the mapping if it gives them, else those in the bag, else those in the
    parameter file beside it, else the defaults. Adds to `warnings` (a list) what could not be read
    and what the poses do not need; raises GroundError for axes that are not a frame.
    """
    warnings = [] if warnings is None else warnings
    axes, heading_offset = mapping.poses.axes, mapping.poses.heading_offset
    given: Dict[str, Any] = {"axes": axes, "heading_offset": heading_offset}
    source = "recorded in the bag"
    changes = _in_bag(bag, path, warnings)
    if not changes:
        changes, source = _beside(path, warnings)
    sources = dict.fromkeys(given, source)
    for name, value in given.items():
        if value is None:
            continue
        option = mapping.sources.get(name, name)
        _check(Setting(0, axes or AXES, heading_offset or 0.0), option)
        if name in taken:
            changes = [replace(s, **{name: value}) for s in changes]
            sources[name] = option
        else:
            warnings.append(
                "%s changes nothing: the bag has %s"
                % (option, "planar poses" if taken else "states, corrected when it was recorded")
            )
    return Settings(tuple(_distinct(changes)), sources, taken)


def default() -> Settings:
    """The default settings, for poses that are not from a bag."""
    sources = {"axes": "default", "heading_offset": "default"}
    return Settings((Setting(0, AXES, 0.0),), sources, ())


def differences(recordings: Sequence["Recording"]) -> str:
    """A line that groups recordings by settings, and by model and room of their controllers, if these
    differ; empty if they do not."""
    parts = flown.differences(recordings)
    for name in ("axes", "heading_offset"):
        groups: Dict[Tuple[Any, ...], List[str]] = {}
        for recording in recordings:
            values = recording.settings.values(name)
            if values is not None:
                groups.setdefault(values, []).append(recording.name)
        if len(groups) > 1:
            parts += [
                "%s %s for %s" % (name, " then ".join("%s" % v for v in values), ", ".join(names))
                for values, names in groups.items()
            ]
    return "the runs were recorded with different settings: " + "; ".join(parts) if parts else ""


def _in_bag(bag: MessageSource, path: str, warnings: List[str]) -> List[Setting]:
    topics = messages.topics_of(bag, TYPE)
    if not topics and messages.announced(bag, TYPE):
        warnings.append("the settings of the mocap that were recorded in the bag are lost")
    if len(topics) > 1:
        raise GroundError(
            "%s: several topics could be the settings of the mocap: %s" % (path, ", ".join(topics))
        )
    found = [
        Setting(m.header.stamp.to_nsec(), m.axes, m.heading_offset)
        for m in messages.of_type(bag, TYPE)
    ]
    return sorted(found, key=lambda s: s.since)


def _distinct(changes: Iterable[Setting]) -> List[Setting]:
    """Removes settings that repeat the one before, as every part of a recording does."""
    kept: List[Setting] = []
    for s in changes:
        if not kept or (s.axes, s.heading_offset) != (kept[-1].axes, kept[-1].heading_offset):
            kept.append(s)
    return kept


def _beside(path: str, warnings: List[str]) -> Tuple[List[Setting], str]:
    """Settings from the parameter file beside a bag, a list of one, and their source."""
    for name, parameters in run_parameters.beside(path, warnings):
        for node in run_parameters.nodes(parameters, "mocap_state"):
            axes, offset = node.get("axes", AXES), node.get("heading_offset", 0.0)
            if isinstance(axes, str) and isinstance(offset, (int, float)):
                return [Setting(0, axes, float(offset))], "recorded in %s" % os.path.basename(name)
    return [Setting(0, AXES, 0.0)], "default"
