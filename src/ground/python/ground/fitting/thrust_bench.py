"""Forces of thrusters that were measured on a bench: curve, gains, and what they are worth.

Thruster j gives the force g_j f(w) at input w (0..1): one curve f for all (thrust_curve), and gains g_j
whose mean is 1. Gains are fitted if they differ significantly. The curve is the simplest one that the
Bayesian information criterion does not clearly reject. Of thrusters that are on or off, there are gains only.
"""

import csv
import re
from collections import Counter
from dataclasses import dataclass, replace
from typing import Callable, Dict, List, Optional, Sequence, Tuple
from typing import Counter as CounterType

import numpy as np
from scipy import stats

from ground.fitting import bench_copies, bench_logs, thrust_curve
from ground.support.annotations import Array, Flags
from ground.support.errors import GroundError

LEVEL = 0.01  # probability of rejecting equal gains that are right
STRONG = 6.0  # difference of the information criterion that is strong evidence (Kass and Raftery 1995)
OFF = 1e-9  # input of a thruster that is off
ROUNDS = 8  # fits of curve and gains, in turn
BOTH = "both"  # column of all thrusters together
BATCHES = 5  # of repetitions in a row, whose drift is common


@dataclass(frozen=True)
class Bench:
    """Measured forces, one row each."""

    inputs: Array  # (n,) 0..1
    together: Array  # (n, m) 1 where thruster j is at work, else 0
    repetition: Array  # (n,) how many rows before it have the same input and thrusters
    forces: Array  # (n,) [N]
    remarks: Tuple[str, ...] = ()  # what was left out
    source: str = ""  # how many pulses of how many logs they are
    timing: Optional[bench_logs.Timing] = None  # how the force follows commands, of logs

    @property
    def levels(self) -> Array:
        """The different inputs above zero."""
        return np.asarray(np.unique(self.inputs[self.inputs > OFF]))

    def part(self, rows: Flags) -> "Bench":
        """Some rows, by their mask (n,)."""
        chosen = (self.inputs, self.together, self.repetition, self.forces)
        inputs, together, repetition, forces = (a[rows] for a in chosen)
        return Bench(inputs, together, repetition, forces)


@dataclass(frozen=True)
class Thrust:
    """The fitted thrust."""

    curve: thrust_curve.Curve  # force of a thruster with gain 1
    gains: Array  # (m,) mean 1; all 1 unless they differ significantly
    values: Dict[str, float]  # k [N]: force at input 1, or at the largest one of a polynomial; p; gains
    intervals: Dict[str, Tuple[float, float]]  # 95%
    p_value: Optional[float]  # that equal gains differ so much; None where it cannot be tested
    rejected: List[Tuple[str, float]]  # simpler curves, with how likely they are: ratio to the best one
    residual: float  # standard deviation of the forces about the fit [N]
    scatter: float  # standard deviation of repeated measurements [N]; nan without any
    switches: bool = False  # whether thrusters were on or off only, so that nothing is known of the curve


def read(
    path: str,
    names: Sequence[str],
    off: float = 0.0,
    full: float = 1.0,
    unit: float = 1.0,
    measured: Optional[Sequence[str]] = None,
) -> Bench:
    """The Bench in a CSV file.

    The header names a column of inputs, then columns of forces: of a thruster by its name, of several
    by their names with + between, of all by "both"; repeated ones have endings such as left_2. names:
    the thrusters of the craft. measured: thrusters that were at work together in all columns, whose
    names then say nothing; or one text with their number. off, full: values of the input that mean 0
    and 1. unit: newtons in one unit of force. Raises GroundError.
    """
    header, rows = _cells(path)
    columns = _columns(path, header, names, measured)
    rows, remarks = bench_copies.without_copies(path, rows, columns, off)
    found = []
    for number, values in rows:
        level = (values[0] - off) / (full - off)
        if not -1e-6 <= level <= 1 + 1e-6:
            raise GroundError(
                "%s: line %d: input %g is not between %g and %g: give what means 0 and 1 with --inputs, "
                "such as --inputs 1000 2000 for microseconds" % (path, number, values[0], off, full)
            )
        level = min(max(level, 0.0), 1.0)
        found += [(level, at, i, unit * values[1 + i]) for i, at in enumerate(columns)]
    return _bench(path, found, remarks)


def read_files(
    paths: Sequence[str],
    names: Sequence[str],
    off: float = 0.0,
    full: float = 1.0,
    unit: Optional[str] = None,
    measured: Optional[Sequence[str]] = None,
    columns: Sequence[str] = (),
) -> Bench:
    """The Bench in a table (read), or in logs of a load cell (bench_logs.read). unit: of the force; N in a
    table without it. columns: of a log. Raises GroundError."""
    logs = [path for path in paths if columns or bench_logs.is_log(_cells(path, only_header=True)[0])]
    if not logs and len(paths) == 1:
        return read(paths[0], names, off, full, bench_logs.NEWTONS[unit or "N"], measured)
    others = [path for path in paths if path not in logs]
    if others:
        raise GroundError("%s: no column of it is a time; give one table, or logs only" % others[0])
    read_logs = [bench_logs.read(path, names, off, full, unit, columns) for path in logs]
    pulses = [pulse for log in read_logs for pulse in log.pulses]
    remarks = [
        "%s: %d of its pulses are left out: the force was not steady in them, or without command beside them"
        % (path, log.lost)
        for path, log in zip(logs, read_logs)
        if log.lost
    ]
    bench = _bench(", ".join(logs), [(p.level, p.together, 0, p.force) for p in pulses], remarks)
    source = "%d pulses in %d logs" % (len(pulses), len(logs))
    return replace(bench, source=source, timing=bench_logs.timing(read_logs))


def _bench(
    path: str, found: Sequence[Tuple[float, Tuple[float, ...], int, float]], remarks: Sequence[str]
) -> Bench:
    """The Bench of forces with their levels, and the thrusters at work. GroundError where thrust at full
    input does not follow from them."""
    levels = {level for level, *_ in found if level > OFF}
    if not levels:
        raise GroundError("%s: a fit needs a force at an input above zero" % path)
    if len(levels) == 1 and min(levels) < 1 - 1e-6:
        raise GroundError(
            "%s: there are forces at the input %g only, so that thrust at full input would be a guess: "
            "measure others; of a thruster that is on or off, say by --inputs which value is on"
            % (path, min(levels))
        )
    seen: "CounterType[Tuple[float, ...]]" = Counter()
    repetition = []
    for level, at, *_ in found:
        repetition.append(seen[(level, *at)])
        seen[(level, *at)] += 1
    inputs, together, _, forces = (np.array(column) for column in zip(*found))
    return Bench(inputs, together, np.array(repetition), forces, tuple(remarks))


def _cells(path: str, only_header: bool = False) -> Tuple[List[str], List[Tuple[int, List[float]]]]:
    """The header, and the numbers of each line that is not empty, with the line's number."""
    try:
        with open(path, newline="", encoding="utf-8-sig") as file:  # spreadsheets write a BOM
            rows = list(csv.reader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise GroundError("%s: cannot be read: %s" % (path, error))
    header = [name.strip() for name in rows[0]] if rows else []
    found: List[Tuple[int, List[float]]] = []
    if only_header:
        return header, found
    for number, row in enumerate(rows[1:], 2):
        if not "".join(row).strip():
            continue
        try:
            values = [float(text) for text in row]
        except ValueError:
            values = []
        if len(values) != len(header) or not np.isfinite(values).all():
            raise GroundError("%s: line %d: must be %d numbers" % (path, number, len(header)))
        found.append((number, values))
    return header, found


def _columns(
    path: str, header: Sequence[str], names: Sequence[str], measured: Optional[Sequence[str]]
) -> List[Tuple[float, ...]]:
    """For each column of forces how many times each thruster is at work."""
    if measured is not None:
        if len(measured) == 1 and measured[0].isdigit() and 1 <= int(measured[0]) <= len(names):
            return [(int(measured[0]) / len(names),) * len(names)] * (len(header) - 1)
        unknown = [name for name in measured if name not in names]
        if unknown or not measured:
            raise GroundError(
                "%s: no thruster is called %s: the model's are %s, or give how many were measured together"
                % (path, ", ".join(unknown), ", ".join(names))
            )
        return [tuple(float(name in measured) for name in names)] * (len(header) - 1)
    columns = [_thrusters(text, names) for text in header[1:]]
    if not columns or not all(columns):
        raise GroundError(
            "%s: line 1 must name the columns: input, then the thrusters (%s, or %s for all of them "
            "together), each optionally with an ending such as %s_2. Where all columns are of the same "
            "thrusters, say so with --thrusters" % (path, ", ".join(names), BOTH, names[0])
        )
    return [tuple(float(name in column) for name in names) for column in columns]


def _thrusters(text: str, names: Sequence[str]) -> List[str]:
    """The thrusters that a column's name means; empty if it means none."""
    for base in (text, re.sub(r"_\d+$", "", text)):
        parts = base.split("+")
        if base == BOTH:
            return list(names)
        if all(part in names for part in parts):
            return parts
    return []


def draft(levels: Sequence[Tuple[float, float]]) -> str:
    """Text of a CSV file for read(), with the inputs of levels (pairs left, right; 0..1) and without
    forces; a repeated level gets another column. Raises GroundError when the columns would not have
    the same inputs."""
    counts: Dict[str, "CounterType[float]"] = {}
    for left, right in levels:
        if left > OFF and right > OFF and left != right:
            raise GroundError(
                "left %.3g and right %.3g at once have no column in a table of forces" % (left, right)
            )
        side = "left" if right <= OFF else "right" if left <= OFF else BOTH
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


def fit(bench: Bench, names: Sequence[str], only: Optional[str] = None) -> Thrust:
    """The Thrust that a Bench of the named thrusters shows. only: a kind of curve (thrust_curve.Curve)
    to be used whatever the evidence. Raises GroundError."""
    driven = bench.part(bench.inputs > OFF)
    if not np.max(driven.forces) > 0:
        raise GroundError("no force is positive: thrusters push, so turn the sign or the table")
    switches = len(bench.levels) == 1
    if switches and only not in (None, "linear"):
        raise GroundError("a %s needs forces at more inputs than the table has, and that rise" % only)
    gains, p_value = _gains(driven)
    curves = [c for c in _curves(driven, gains) if only is None or c.kind == only]
    if not curves:
        raise GroundError("a %s needs forces at more inputs than the table has, and that rise" % only)
    chosen, rejected = _choose(driven, gains, curves)

    def refit(part: Bench) -> Dict[str, float]:
        again = _again(part, chosen)
        again = replace(again, largest=chosen.largest)  # also without the largest level
        return _values(again, _fit_gains(part, again) if (gains != 1).any() else gains, names)

    misfit = driven.forces - (driven.together @ gains) * chosen.force(driven.inputs)
    free = chosen.order + int((gains != 1).any()) * _separate(driven)
    values = _values(chosen, gains, names)
    return Thrust(
        chosen,
        gains,
        values,
        _intervals(driven, values, refit),
        p_value,
        rejected,
        float(np.sqrt(misfit @ misfit / max(1, len(misfit) - free))),
        _scatter(driven),
        switches,
    )


def _values(curve: thrust_curve.Curve, gains: Array, names: Sequence[str]) -> Dict[str, float]:
    """k, p of a power, and gains that are not 1, by their names."""
    k = curve.full
    values = {"k": k if curve.power is None else k / curve.largest**curve.power}
    if curve.kind == "power":
        values["p"] = float(curve.power or 1.0)
    if (gains != 1).any():
        values.update(zip(names, map(float, gains)))
    return values


def _curves(bench: Bench, gains: Array) -> List[thrust_curve.Curve]:
    working = bench.together @ gains
    kinds = thrust_curve.KINDS if len(bench.levels) > 1 else thrust_curve.KINDS[:1]
    found = [kind(bench.inputs, working, bench.forces) for kind in kinds]
    return [curve for curve in found if curve is not None and curve.full > 0]


def _again(bench: Bench, like: thrust_curve.Curve) -> thrust_curve.Curve:
    """A curve of the same kind and order, fitted to other forces; as it is where that fails."""
    for curve in _curves(bench, np.ones(bench.together.shape[1])):
        if (curve.kind, curve.order) == (like.kind, like.order):
            return curve
    return like


def _separate(bench: Bench) -> int:
    """The number of gains that the columns can separate."""
    return int(np.linalg.matrix_rank(bench.together)) - 1


def _fit_gains(bench: Bench, curve: thrust_curve.Curve) -> Array:
    """Gains with mean 1; those that the columns do not separate are the same."""
    force = curve.force(bench.inputs)
    basis = force[:, None] * bench.together
    # minimum norm: what the data leave open stays at 1
    change = np.linalg.lstsq(basis, bench.forces - basis.sum(axis=1), rcond=1e-9)[0]
    gains = 1 + change
    return np.asarray(gains / gains.mean())


def _gains(bench: Bench) -> Tuple[Array, Optional[float]]:
    """Gains, all 1 unless they differ significantly by an F test with the most flexible curve, and its
    p-value."""
    ones = np.ones(bench.together.shape[1])
    separate = _separate(bench)
    if separate < 1:
        return ones, None
    gains, squares = ones, []
    for _ in range(ROUNDS):
        curve = _curves(bench, gains)[-1]
        misfit = bench.forces - (bench.together @ gains) * curve.force(bench.inputs)
        squares.append(float(misfit @ misfit))
        gains = _fit_gains(bench, curve)
    freedom = len(bench.forces) - curve.order - separate
    if freedom < 1:
        return ones, None
    least = max(min(squares), 1e-12 * max(squares[0], 1e-300))
    p_value = float(stats.f.sf((squares[0] - least) / separate / (least / freedom), separate, freedom))
    return (gains if p_value < LEVEL else ones), p_value


def _scatter(bench: Bench) -> float:
    """Standard deviation of repetitions; nan without any."""
    kinds = np.column_stack([bench.inputs, bench.together])
    group = np.unique(kinds, axis=0, return_inverse=True)[1].ravel()
    count = np.bincount(group)
    freedom = len(group) - len(count)
    misfit = bench.forces - (np.bincount(group, bench.forces) / count)[group]
    return float(np.sqrt(misfit @ misfit / freedom)) if freedom else float("nan")


def _choose(
    bench: Bench, gains: Array, curves: Sequence[thrust_curve.Curve]
) -> Tuple[thrust_curve.Curve, List[Tuple[str, float]]]:
    """The simplest curve that the forces do not reject, and the simpler ones, by their evidence's ratio."""
    working, n = bench.together @ gains, len(bench.forces)
    least = 1e-12 * float(bench.forces @ bench.forces)
    squares = [((bench.forces - working * c.force(bench.inputs)) ** 2).sum() for c in curves]
    score = [n * np.log(max(s, least) / n) + c.order * np.log(n) for s, c in zip(squares, curves)]
    near = next(i for i, s in enumerate(score) if s - min(score) < STRONG)
    rejected = [(c.words, float(np.exp((min(score) - s) / 2))) for s, c in zip(score, curves)]
    return curves[near], rejected[:near]


def _intervals(
    bench: Bench, values: Dict[str, float], refit: Callable[[Bench], Dict[str, float]]
) -> Dict[str, Tuple[float, float]]:
    """95% intervals by the jackknife: the widest one of leaving out levels, repetitions, whose errors are not
    independent when a whole repetition is off, and batches of many repetitions, which drift."""
    away = {name: 0.0 for name in values}
    count = int(bench.repetition.max()) + 1
    batches = bench.repetition * BATCHES // count if count >= 2 * BATCHES else bench.repetition
    for key in (bench.inputs, bench.repetition, batches):
        groups = np.unique(key)
        if len(groups) < 2:
            continue
        parts = [bench.part(key != group) for group in groups]
        found = [
            refit(part) for part in parts if len(part.levels) == len(bench.levels) or len(part.levels) > 1
        ]
        count = len(found)
        if count < 2:
            continue
        quantile = stats.t.ppf(0.975, count - 1)
        for name in values:
            each = np.array([one.get(name, 1.0) for one in found])
            error = np.sqrt((count - 1) / count * ((each - each.mean()) ** 2).sum())
            away[name] = max(away[name], float(quantile * error))
    # none of them can be negative
    return {name: (max(0.0, value - away[name]), value + away[name]) for name, value in values.items()}
