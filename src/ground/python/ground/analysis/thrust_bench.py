"""Force against input of thrusters on a bench (thesis 3.2, figure 3.1): a model's thrust.

The force of a thruster at input w (0..1) is k (1 + a) w^p on the left, k (1 - a) w^p on the right
(effects thrust_asymmetry, thrust_curve). A curve or an asymmetry is fitted only if it is
significant.
"""

import csv
from collections import Counter
from dataclasses import dataclass
from typing import Counter as CounterType
from typing import Dict, Mapping, Sequence, Tuple

import numpy as np
from scipy import optimize, stats
from scipy.optimize import OptimizeResult

from ground.annotations import Array
from ground.errors import GroundError

SIDES = {"left": (1.0, 0.0), "right": (0.0, 1.0), "both": (1.0, 1.0)}  # thrusters in a column
LEVEL = 0.01  # probability of finding a curve or an asymmetry where there is none
OFF = 1e-9  # input of a thruster that is off
# Start and bounds of a fit; k as a share of the largest force of a thruster.
START = {"k": 1.0, "a": 0.0, "p": 1.0}
BOUNDS = {"k": (1e-3, 1e3), "a": (-1.0, 1.0), "p": (0.2, 5.0)}


@dataclass(frozen=True)
class Bench:
    """Measured forces, one row each."""

    inputs: Array  # (n,) 0..1
    left: Array  # (n,) 1 where the left thruster is at work, else 0
    right: Array  # (n,)
    forces: Array  # (n,) [N]


@dataclass(frozen=True)
class Thrust:
    """The fitted thrust."""

    values: Dict[str, float]  # k [N], and a [-], p [-] where they are significant
    intervals: Dict[str, Tuple[float, float]]  # 95%
    p_values: Dict[str, float]  # of a and p, where they can be tested
    residual: float  # standard deviation of the forces about the fit [N]
    scatter: float  # standard deviation of repeated measurements [N]; nan without any

    def force(self, bench: Bench) -> Array:
        """Forces (n,) [N] that the fit expects on a Bench."""
        return _force(self.values, bench)


def read(path: str, off: float = 0.0, full: float = 1.0, unit: float = 1.0) -> Bench:
    """The Bench in a CSV file whose header names a column input and columns left, right or both
    (both thrusters together), repeated ones with endings of their own such as left_2. off, full:
    values of input that mean 0 and 1; unit: newtons in one unit of force. Raises GroundError."""
    try:
        with open(path, newline="", encoding="utf-8-sig") as file:  # spreadsheets write a BOM
            rows = list(csv.reader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise GroundError("%s: cannot be read: %s" % (path, error))
    header = [name.strip() for name in rows[0]] if rows else []
    columns = {i: name.split("_")[0] for i, name in enumerate(header) if i > 0}
    if header[:1] != ["input"] or not columns or not set(columns.values()) <= set(SIDES):
        raise GroundError(
            "%s: line 1 must name the columns: input, then left, right or both, each optionally with an "
            "ending such as left_2" % path
        )
    found = []
    for number, row in enumerate(rows[1:], 2):
        if not "".join(row).strip():
            continue
        try:
            values = [float(text) for text in row]
        except ValueError:
            values = []
        if len(values) != len(header) or not np.isfinite(values).all():
            raise GroundError("%s: line %d: must be %d numbers" % (path, number, len(header)))
        level = (values[0] - off) / (full - off)
        if not -1e-6 <= level <= 1 + 1e-6:
            raise GroundError(
                "%s: line %d: input %g is not between %g and %g: give what means 0 and 1 with --inputs"
                % (path, number, values[0], off, full)
            )
        level = min(max(level, 0.0), 1.0)
        found += [(level, *SIDES[side], unit * values[i]) for i, side in columns.items()]
    if len({level for level, *_ in found if level > OFF}) < 2:
        raise GroundError("%s: a fit needs forces at two inputs above zero" % path)
    return Bench(*np.array(found).T)


def draft(levels: Sequence[Tuple[float, float]]) -> str:
    """Text of a CSV file for read(), with the inputs of levels (pairs left, right; 0..1) and without
    forces; a repeated level gets another column. Raises GroundError when the columns would not have
    the same inputs."""
    counts: Dict[str, "CounterType[float]"] = {}
    for left, right in levels:
        if left > OFF and right > OFF and left != right:
            raise GroundError(
                "left %.3g and right %.3g at once have no column in a table of forces"
                % (left, right)
            )
        side = "left" if right <= OFF else "right" if left <= OFF else "both"
        if max(left, right) > OFF:
            counts.setdefault(side, Counter())[max(left, right)] += 1
    inputs = {tuple(sorted(count)) for count in counts.values()}
    if len(inputs) != 1 or any(len(set(count.values())) > 1 for count in counts.values()):
        raise GroundError("the thrusters were not held at the same levels equally often")
    header = ["input"]
    for side, count in counts.items():
        rounds = next(iter(count.values()))
        header += ["%s_%d" % (side, i + 1) for i in range(rounds)] if rounds > 1 else [side]
    rows = ["%.6g" % level + "," * (len(header) - 1) for level in inputs.pop()]
    return "\n".join([",".join(header)] + rows) + "\n"


def fit(bench: Bench) -> Thrust:
    """The Thrust that a Bench shows."""
    names = ["k"]
    tested = ["a"] if bench.left.any() and bench.right.any() and _apart(bench) else []
    if len(np.unique(bench.inputs[bench.inputs > OFF])) > 2:
        tested.append("p")
    p_values = {}
    whole = _least_squares(bench, names + tested)
    for name in tested:
        without = _least_squares(bench, [n for n in names + tested if n != name])
        p_values[name] = _chance(without.cost, whole.cost, len(bench.forces) - 1 - len(tested))
    names += [name for name in tested if p_values[name] < LEVEL]
    found = _least_squares(bench, names)
    scale = _scale(bench)
    freedom = len(bench.forces) - len(names)
    variance = 2 * found.cost / freedom
    covariance = variance * np.linalg.inv(found.jac.T @ found.jac)
    away = stats.t.ppf(0.975, freedom) * np.sqrt(np.diag(covariance))
    units = [scale if name == "k" else 1.0 for name in names]
    return Thrust(
        {n: float(u * x) for n, u, x in zip(names, units, found.x)},
        {
            n: (float(u * (x - d)), float(u * (x + d)))
            for n, u, x, d in zip(names, units, found.x, away)
        },
        p_values,
        float(scale * np.sqrt(variance)),
        _scatter(bench),
    )


def _apart(bench: Bench) -> bool:
    """Whether some forces are of one thruster alone."""
    return bool((bench.left != bench.right).any())


def _force(values: Mapping[str, float], bench: Bench) -> Array:
    a = values.get("a", 0.0)
    sides = (1 + a) * bench.left + (1 - a) * bench.right
    power = np.where(bench.inputs > OFF, bench.inputs, 0.0) ** values.get("p", 1.0)
    return values["k"] * sides * power


def _scale(bench: Bench) -> float:
    """Largest force of one thruster [N]."""
    largest = float(np.max(bench.forces / (bench.left + bench.right)))
    if not largest > 0:
        raise GroundError("no force is positive: thrusters push, so turn the sign or the table")
    return largest


def _least_squares(bench: Bench, names: Sequence[str]) -> OptimizeResult:
    scale = _scale(bench)

    def residuals(x: Array) -> Array:
        return _force(dict(zip(names, x)), bench) - bench.forces / scale

    bounds = np.array([BOUNDS[n] for n in names]).T
    return optimize.least_squares(
        residuals, [START[n] for n in names], bounds=bounds, x_scale="jac"
    )


def _chance(without: float, whole: float, freedom: int) -> float:
    """p-value of one more parameter, by the fall of the sum of squares (F test)."""
    if freedom < 1:
        return 1.0
    whole = max(whole, 1e-12 * max(without, 1e-300))
    return float(stats.f.sf(max(0.0, without - whole) / (whole / freedom), 1, freedom))


def _scatter(bench: Bench) -> float:
    kinds = np.column_stack([bench.inputs, bench.left, bench.right])
    _, group = np.unique(kinds, axis=0, return_inverse=True)
    count = np.bincount(group)
    freedom = len(group) - len(count)
    if freedom < 1:
        return float("nan")
    mean = np.bincount(group, bench.forces) / count
    return float(np.sqrt(((bench.forces - mean[group]) ** 2).sum() / freedom))
