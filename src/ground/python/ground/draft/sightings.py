"""Which columns probably have a pose, and in which frame its heading is, by names and by the motion."""

import re
from dataclasses import dataclass
from typing import Dict, Iterator, List, Mapping, Sequence, Tuple

import numpy as np

from ground.reading import places, pose_columns, words
from ground.support.annotations import Array

CLEAR = 0.75  # mean resultant of headings against the course that may decide
TURNED, SHARE = 0.1, 0.35  # least lack of the other sign's, and largest share of it that decide
LONG_WAY = 30.0  # steps of the course, in standard deviations of the noise of positions
TURNS = 0.1  # size of a component of a quaternion that is not near 0
SAME = 1e-3  # difference of two columns with the same numbers, of their range
COMPONENTS = ("x", "y", "z", "w")


@dataclass(frozen=True)
class PoseColumns:
    """Columns that have a pose."""

    position: Tuple[str, ...] = ()  #: x and y as the columns have them, or x, y, z
    rotation: Tuple[str, ...] = ()  #: quaternion x, y, z, w, or heading
    kind: str = "xy"  #: what the position is: xy, map (north, east) or fix (latitude, longitude)


def of_columns(values: Mapping[str, Array]) -> List[PoseColumns]:
    """The poses that columns may have, the likeliest first."""
    turns = [*_quaternions(values), *_headings(values)]
    found = []
    for position, kind, worth, stem in _positions(values):
        for rotation, likely, about in turns:
            if set(rotation) & set(position) or (kind != "xy" and len(position) == 2 and len(rotation) == 4):
                continue
            alike = len(set(stem) & set(about)) - 0.5 * len(
                set(about) - set(stem) - words.TURNED - words.MEASURED
            )
            found.append((worth + likely + alike, PoseColumns(position, rotation, kind)))
    return [pose for _, pose in sorted(found, key=lambda one: -one[0])]


def _positions(values: Mapping[str, Array]) -> Iterator[Tuple[Tuple[str, ...], str, float, words.Stem]]:
    """Columns of positions, their kind, how likely they are, and the words that they share."""
    by_stem: Dict[Tuple[words.Stem, int], Dict[str, str]] = {}  # by number of equal names: x_odom, x_map
    for name in values:
        axis, stem = words.axis(name)
        if axis:
            number = 0
            while _both_move(values, by_stem.get((stem, number), {}).get(axis, name), name):
                number += 1
            axes = by_stem.setdefault((stem, number), {})
            if axis not in axes or np.ptp(_finite(values[axes[axis]])) == 0:  # of a repeated name, what moves
                axes[axis] = name
    for first in (name for name in values if words.split(name)[-2:] in (["eta", "0"], ["pose", "0"])):
        every = [re.sub("0(?=[^0]*$)", str(number), first) for number in range(3)]
        if set(every) <= set(values):
            yield (every[0], every[1]), "xy", 2.0, (every[2],)
    for first in (name for name in values if re.search(r"(^|[_.])(pos|position|xyz|p)[_.\[]?[01]\]?$", name)):
        digit = int(re.findall("[01]", first)[-1])
        every = [re.sub("[01](?=[^01]*$)", str(digit + number), first) for number in range(3)]
        there = tuple(name for name in every if name in values)
        if there[:2] == tuple(every[:2]) and not (digit and re.sub("1(?=[^1]*$)", "0", first) in values):
            yield there, "xy", 1.5, tuple(words.split(first)[:-1])
    for (stem, number), axes in by_stem.items():
        first_ones = by_stem[stem, 0]
        if number and all(same(values, first_ones.get(axis, name), name) for axis, name in axes.items()):
            continue
        others = set(stem) - words.PLACED - words.MEASURED
        worth = 2.0 - 0.5 * len(others) + 0.7 * bool(set(stem) & words.MEASURED)
        for kind, letters, less in (("xy", "xyz", 0.0), ("map", "ne", 0.0), ("fix", ("lat", "lon"), 2.0)):
            names = tuple(axes[letter] for letter in letters if letter in axes)
            moves = [name for name in names if np.ptp(_finite(values[name])) > 0]
            if len(names) >= 2 and len(names) >= len(letters) - 1 and moves:
                if kind == "xy" and places.look_geodetic(np.column_stack([values[n] for n in names])):
                    kind = "fix"
                yield names, kind, worth - less - (len(moves) < 2), stem


def _both_move(values: Mapping[str, Array], one: str, other: str) -> bool:
    """Whether two columns, not one, have numbers that change."""
    return one != other and all(np.ptp(_finite(values[name])) > 0 for name in (one, other))


def same(values: Mapping[str, Array], one: str, other: str) -> bool:
    """Whether two columns have the same numbers, but for a unit and an offset, or one never changes."""
    both = np.column_stack([values[one], values[other]])
    both = both[np.isfinite(both).all(axis=1)]
    if one == other or len(both) < 3 or not (np.ptp(both, axis=0) > 0).all():
        return True
    left = both[:, 1] - np.polyval(np.polyfit(both[:, 0], both[:, 1], 1), both[:, 0])
    return bool(np.abs(left).max() < SAME * np.ptp(both[:, 1]))


def _quaternions(values: Mapping[str, Array]) -> Iterator[Tuple[Tuple[str, ...], float, words.Stem]]:
    by_stem: Dict[words.Stem, Dict[str, str]] = {}
    for name in values:
        part, stem = words.component(name)
        if part:
            by_stem.setdefault(stem, {})[part] = name
    for stem, parts in by_stem.items():
        if set(COMPONENTS) <= set(parts):
            names = tuple(parts[one] for one in COMPONENTS)
        elif set(stem) & words.TURNED and len(parts) >= 4:
            numbered = [parts[one] for one in sorted(parts)][:4]
            names = _w_first(numbered, values)
        else:
            continue
        length = sum(values[name] ** 2 for name in names)
        if np.median(np.abs(_finite(np.asarray(length)) - 1)) < 0.1:
            yield names, 1.2, stem


def _w_first(names: Sequence[str], values: Mapping[str, Array]) -> Tuple[str, ...]:
    """A numbered quaternion as x, y, z, w. Of a craft that stays upright about y or z, w and the component of
    the vertical are not near 0: the first number is only w. Where one number is not near 0 alone, a count
    from 0 begins with w."""
    sizes = [float(np.sqrt(np.mean(_finite(values[name]) ** 2))) for name in names]
    from_zero = words.split(names[0])[-1] == "0"
    first = sizes[0] > TURNS or (from_zero and sorted(sizes)[2] <= TURNS)
    return (*names[1:], names[0]) if first else tuple(names)


def _headings(values: Mapping[str, Array]) -> Iterator[Tuple[Tuple[str, ...], float, words.Stem]]:
    for name in values:
        likely, stem = words.heading(name)
        if words.split(name)[-2:] in (["eta", "2"], ["pose", "2"]):
            likely, stem = 0.6, (name,)
        if likely and np.ptp(_finite(values[name])) > 0:
            yield (name,), likely, stem


def _finite(values: Array) -> Array:
    found: Array = values[np.isfinite(values)]
    return found if len(found) else np.zeros(1)


def fields_of_kind(kind: str) -> PoseColumns:
    """The pose of a known type of messages."""
    position, rotation = pose_columns.KINDS[kind].fields()
    return PoseColumns(position, rotation)


@dataclass(frozen=True)
class Turn:
    """How headings relate to the course over ground."""

    sign: int  #: sign of headings
    offset: float  #: mean of signed headings minus course [rad]
    resultant: float  #: 0 to 1: how well they agree
    other: float  #: the same for the other sign

    @property
    def is_clear(self) -> bool:
        """Whether the motion decides the sign."""
        lack = 1 - self.other
        return self.resultant > CLEAR and lack > TURNED and 1 - self.resultant < SHARE * lack


def against_course(position: Array, headings: Array) -> Turn:
    """Headings (n,) [rad] against the direction in which positions (n, 2) move, over steps that are long
    against their noise."""
    step = 1
    noise = float(np.median(np.abs(np.diff(position, 2, axis=0)))) if len(position) > 3 else 0.0
    while step < len(position) // 20:
        way = np.linalg.norm(position[step:] - position[:-step], axis=1)
        if np.quantile(way, 0.5) > LONG_WAY * noise:
            break
        step *= 2
    move = position[step:] - position[:-step]
    course, weight = np.arctan2(move[:, 1], move[:, 0]), np.linalg.norm(move, axis=1)
    middle = headings[step // 2 : step // 2 + len(course)]
    if not weight.sum() > 0:
        return Turn(1, 0.0, 0.0, 0.0)
    means = {sign: np.average(np.exp(1j * (sign * middle - course)), weights=weight) for sign in (1, -1)}
    best = 1 if abs(means[1]) >= abs(means[-1]) else -1
    return Turn(best, float(np.angle(means[best])), float(abs(means[best])), float(abs(means[-best])))
