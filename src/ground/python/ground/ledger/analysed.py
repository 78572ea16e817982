"""The runs of one type of craft together: levels, scatters, changes, and crafts that are odd."""

import itertools
import os
from dataclasses import dataclass, replace
from typing import Dict, List, Optional, Sequence, Tuple

import numpy as np

from ground.analysis.distributions import normal_limit
from ground.effect_library.parameters import described
from ground.ledger import changes, estimates, hierarchy
from ground.ledger.changes import ParameterChange, Series
from ground.ledger.estimates import RunEstimate
from ground.ledger.hierarchy import Levels, Runs
from ground.models import Model
from ground.support.annotations import Array, Indices
from ground.support.origin import digest

CHANCE = 0.02  # of any false change, or any false odd craft, in all parameters and crafts of a type
TESTS = 2  # for each parameter and craft: does it drift, does it jump
THRUST = ("k", "thruster_gain_")  # begins of the names of thrusts, which age first: they get half of CHANCE
MIN_ODD_RATIO = 3.0  # an odd craft is this many times as far off as the others are apart
Ends = List[Optional[float]]  # low and high of a 95% interval; None: beyond all values


@dataclass(frozen=True)
class Odd:
    """A craft that differs from the others of its type."""

    craft: int
    parameter: int
    difference: float  #: from the median of the others, in scales
    alone: bool  #: whether there is one other craft only, so that either may be the odd one


@dataclass(frozen=True)
class Analysed:
    """What the runs of a type tell. Coordinates are in scales; runs are in order of time."""

    model: Model
    free: List[str]
    scale: Array  #: (p,)
    crafts: List[str]
    runs: Runs
    levels: Levels  #: with changes taken out
    each: Array  #: (n, p) what each run tells about each parameter alone
    known: Array  #: (n, p) its information
    changes: Dict[Tuple[int, int], List[ParameterChange]]  #: by craft and parameter
    curves: Array  #: (n, p) mean with the changes; not a number where a run tells nothing
    odd: List[Odd]

    def of(self, craft: int, parameter: int) -> Indices:
        """The runs of a craft that tell anything about a parameter."""
        own = np.flatnonzero(self.runs.craft == craft)
        return own[changes.informative(1 / np.maximum(self.known[own, parameter], 1e-300))]

    def level(self, parameter: int) -> float:
        """The chance below which a change of a parameter of one craft is reported."""
        are_thrust = [name.startswith(THRUST) for name in self.free]
        alike = sum(one == are_thrust[parameter] for one in are_thrust)
        share = 1.0 if all(are_thrust) or not any(are_thrust) else 0.5
        return CHANCE * share / (alike * TESTS * len(self.crafts))

    def value(self, parameter: int, coordinate: float) -> float:
        """A coordinate in scales as a value of the parameter, in its bounds."""
        name, x = self.free[parameter], coordinate * self.scale[parameter]
        flip = estimates.reciprocal(self.model.core, self.free)[parameter]
        known = described(self.model.core)[name]
        return float(np.clip(1 / x if flip and x else x, known.lower, known.upper))

    def interval(self, parameter: int, coordinate: float, low: float, high: float) -> Tuple[float, Ends]:
        """Value and interval of a coordinate."""
        flip = estimates.reciprocal(self.model.core, self.free)[parameter]
        ends = [None if flip and end <= 0 else self.value(parameter, end) for end in (low, high)]
        return self.value(parameter, coordinate), ends[::-1] if flip else ends


def analyse(
    model: Model, found: Sequence[RunEstimate], crafts: Sequence[str], days: Sequence[str], tolerance: float
) -> Analysed:
    """Analyses the estimates of the runs of a type, in order of time. crafts, days: of each run; tolerance:
    difference between crafts, in scales, that is none."""
    names = sorted(set(crafts))
    pairs = list(zip(crafts, days))
    ordered = sorted(set(pairs))
    y = np.array([one.coordinates for one in found], float)
    runs = Runs(
        y,
        np.array([one.information for one in found], float),
        np.array([names.index(craft) for craft in crafts]),
        np.array([ordered.index(pair) for pair in pairs]),
    )
    levels = hierarchy.fit(runs)
    each, known = hierarchy.one_by_one(runs, levels)
    free, scale = list(found[0].free), np.array(found[0].scale)
    nothing = np.full(y.shape, np.nan)
    made = Analysed(model, free, scale, names, runs, levels, each, known, {}, nothing, [])
    made, shifts = _with_changes(made)
    if shifts.any():  # the levels are of all runs, as if the craft had always been as it is now
        levels = hierarchy.fit(replace(runs, y=y - shifts))
    return replace(made, levels=levels, odd=list(_odd(levels, tolerance)))


def _with_changes(made: Analysed) -> Tuple[Analysed, Array]:
    """The same with the changes of each parameter of each craft, and how far each run (n, p) was from the
    newest one by them."""
    found: Dict[Tuple[int, int], List[ParameterChange]] = {}
    curves, shifts = made.curves.copy(), np.zeros(made.curves.shape)
    for craft, i in itertools.product(range(len(made.crafts)), range(len(made.free))):
        at = made.of(craft, i)
        if not len(at):
            continue
        series = Series(made.each[at, i], 1 / made.known[at, i], made.runs.day[at])
        found[craft, i] = _changes(series, made.level(i))
        curves[at, i] = changes.curve(series, found[craft, i])
        if found[craft, i]:
            own = np.flatnonzero(made.runs.craft == craft)
            shifts[own, i] = np.interp(own, at, curves[at, i] - curves[at[-1], i])
    return replace(made, changes=found, curves=curves), shifts


@dataclass(frozen=True)
class KeptChanges:
    """The changes of a series, as the cache has them."""

    changes: List[ParameterChange]


def _changes(series: Series, level: float) -> List[ParameterChange]:
    """The changes of a series, from the cache where they are known."""
    parts = [array.tobytes() for array in (series.values, series.variance, series.day)]
    key = digest([*parts, b"%g %d" % (level, estimates.KEPT)])
    path = os.path.join(estimates.cache_folder(), "changes-%s.json" % key)
    found = estimates.kept(KeptChanges, path)
    if found is None:
        found = KeptChanges(changes.find(series, level))
        estimates.keep(path, found)
    return found.changes


def _odd(levels: Levels, tolerance: float) -> List[Odd]:
    """Crafts whose level differs from the median of the others by more than the tolerance beyond chance, and
    by far more than these differ among themselves."""
    crafts, p = levels.mean.shape
    found = []
    limit = normal_limit(CHANCE / (2 * p * max(crafts, 1)))
    for i in range(p):
        variance = levels.covariance[:, i, i]
        for craft in range(crafts if crafts > 2 else crafts - 1):
            others = np.array([other for other in range(crafts) if other != craft], int)
            difference = levels.mean[craft, i] - np.median(levels.mean[others, i])
            doubt = np.sqrt(variance[craft] + variance[others].mean())
            apart = np.ptp(levels.mean[others, i])
            if abs(difference) - tolerance > limit * doubt and abs(difference) > MIN_ODD_RATIO * apart:
                found.append(Odd(craft, i, float(difference), crafts == 2))
    return found
