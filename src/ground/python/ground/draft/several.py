"""What topics and tables have, and which of them have commands of a thruster each."""

import re
from dataclasses import dataclass, field
from typing import Dict, Iterator, List, Mapping, Sequence, Tuple

import numpy as np

from ground.draft import levels, sightings
from ground.reading import words
from ground.support.annotations import Array


@dataclass
class Seen:
    """The numbers of a topic, or of one body on it, and what they probably are."""

    topic: str
    kind: str
    count: int
    values: Dict[str, Array]  # by path; each (n,), the first of them
    whole: Dict[str, Array]  # all of them, of which one may be the largest
    times: Array  # (n,) by the header, of receipt, or of a column [s]
    body: str = ""  # that the poses are of
    units: Mapping[str, str] = field(default_factory=dict)  # that the file says, by path
    clock: str = ""  # the key `time` of a table
    clock_fields: Tuple[str, ...] = ()
    poses: List[sightings.PoseColumns] = field(default_factory=list)  # the likeliest first

    @property
    def name(self) -> str:
        """Topic and body."""
        return self.topic + (", body %s" % self.body if self.body else "")

    @property
    def pose(self) -> sightings.PoseColumns:
        """The likeliest pose, empty without any."""
        return self.poses[0] if self.poses else sightings.PoseColumns()

    def rows(self, pose: sightings.PoseColumns) -> Tuple[Array, Array, Array]:
        """Times (n,), position (n, k) and rotation (n, k) of a pose, where there are all of them."""
        found = np.column_stack([self.values[path] for path in pose.position + pose.rotation])
        good = np.isfinite(found).all(axis=1) & np.isfinite(self.times)
        count = len(pose.position)
        return self.times[good], found[good, :count], found[good, count:]


SIDES = words.CHANNELS["left"] | words.CHANNELS["right"]
SIDES |= {"bow", "stern", "front", "back", "rear", "fore", "aft", "main", "lift", "fan"}
END = re.compile(r"(\.[a-z]{2,4}){1,2}$")  # of the name of a file


def of(chosen: Seen, every: Sequence[Seen]) -> List[Seen]:
    """The topics with commands that are named as the chosen one but for a number or a side, at the same
    time; only the chosen one where the poses are named so too: then each is of another run or craft."""
    wanted, stem = set(levels.likely(chosen.topic, chosen.values)), _stem(chosen.topic)
    alike = {
        seen.topic: seen
        for seen in every
        if seen.kind == chosen.kind and _stem(seen.topic) == stem and wanted <= set(seen.values)
        if seen.topic != chosen.topic and covers(seen.times, chosen.times)
    }
    posed = {_marks(seen.topic) for seen in every if seen.poses and seen.topic not in (chosen.topic, *alike)}
    if not alike or any(marks and marks in posed for marks in map(_marks, (chosen.topic, *alike))):
        return [chosen]
    return sorted([chosen, *alike.values()], key=lambda seen: [*map(_order, _marks(seen.topic))])


def fields(parts: Sequence[Seen]) -> List[str]:
    """Fields of commands that all of some topics have."""
    found = {path: None for part in parts for path in levels.likely(part.topic, part.values)}
    clocks = {path for part in parts for path in part.clock_fields}
    return [path for path in found if path not in clocks and all(path in part.values for part in parts)]


def names(parts: Sequence[Seen], paths: Sequence[str]) -> Iterator[Tuple[Seen, Dict[str, str]]]:
    """The names of channels by field, for each of some topics."""
    for part in parts:
        marks = "_".join(_marks(part.topic))
        yield part, {path: _name(part.topic, path, marks, len(paths) == 1) for path in paths}


def _name(topic: str, path: str, marks: str, is_only: bool) -> str:
    if is_only and marks in SIDES:
        return next((name for name, known in words.CHANNELS.items() if marks in known), marks)
    if is_only:  # the part of the topic's name that tells it from the others
        part = next(p for p in END.sub("", topic).split("/") if set(_parts(p)) & set(marks.split("_")))
        return levels.plain(part)
    return levels.plain(path) + "_" + marks


def _parts(topic: str) -> List[str]:
    return [word.lower() for word in re.findall(r"[^\W\d_]+|\d+", END.sub("", topic))]


def _is_mark(word: str) -> bool:
    return word.isdigit() or word in SIDES


def _marks(topic: str) -> Tuple[str, ...]:
    """The numbers and sides in a name."""
    return tuple(filter(_is_mark, _parts(topic)))


def _order(mark: str) -> Tuple[int, str]:
    """Left before right before lift; numbers by their size."""
    order = (at for at, known in enumerate(words.CHANNELS.values()) if mark in known)
    return next(order, len(words.CHANNELS)), mark.zfill(6)


def _stem(topic: str) -> Tuple[str, ...]:
    """A name with its numbers and sides left open."""
    return tuple("" if _is_mark(word) else word for word in _parts(topic))


def covers(times: Array, span: Array, share: float = 0.0) -> bool:
    """Whether some times (n,) cover more than a share of the span of others (m,), both in [s]."""
    times, span = levels.finite(times), levels.finite(span)
    if not len(times) or not len(span):
        return False
    return bool(min(times.max(), span.max()) - max(times.min(), span.min()) > share * np.ptp(span))
