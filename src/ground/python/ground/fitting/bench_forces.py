"""Forces of thrusters that were measured on a bench, read from a table or from logs of a load cell."""

import csv
import re
from collections import Counter
from dataclasses import dataclass, replace
from typing import Counter as CounterType
from typing import Dict, List, Optional, Sequence, Tuple

import numpy as np

from ground.analysis.distributions import LEVEL
from ground.fitting import bench_logs
from ground.fitting.bench_logs import BenchFormat
from ground.support.annotations import Array, Flags
from ground.support.errors import GroundError

OFF = 1e-9  # input of a thruster that is off
BOTH = "both"  # column of all thrusters together

Row = Tuple[int, List[float]]  #: line, and the numbers: input, then forces


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


def read(paths: Sequence[str], form: BenchFormat) -> Bench:
    """The Bench in a table, or in logs of a load cell (bench_logs.read). Raises GroundError."""
    logs = [path for path in paths if form.columns or bench_logs.is_log(_cells(path, only_header=True)[0])]
    if not logs and len(paths) == 1:
        return _of_table(paths[0], form)
    others = [path for path in paths if path not in logs]
    if others:
        raise GroundError("%s: no column is a time; give one table, or only logs" % others[0])
    read_logs = [bench_logs.read(path, form) for path in logs]
    pulses = [pulse for log in read_logs for pulse in log.pulses]
    remarks = [
        "%s: %d of its pulses are left out: the force was not steady in them, or without command beside them"
        % (path, log.lost)
        for path, log in zip(logs, read_logs)
        if log.lost
    ]
    bench = _bench(", ".join(logs), [(p.level, p.together, p.force) for p in pulses], remarks)
    source = "%d pulses in %d logs" % (len(pulses), len(logs))
    return replace(bench, source=source, timing=bench_logs.timing(read_logs))


def _of_table(path: str, form: BenchFormat) -> Bench:
    """The Bench in a CSV file. The header names a column of inputs, then columns of forces: of a thruster by
    its name, of several by their names with + between, of all by "both"; repeated ones have endings such as
    left_2."""
    header, rows = _cells(path)
    columns = _columns(path, header, form)
    rows, remarks = without_copies(path, rows, columns, form.off)
    found = []
    for number, values in rows:
        level = form.level(values[0])
        if not -1e-6 <= level <= 1 + 1e-6:
            raise GroundError(
                "%s: line %d: input %g is not between %g and %g: define 0 and 1 with --inputs, "
                "such as --inputs 1000 2000 for microseconds" % (path, number, values[0], form.off, form.full)
            )
        newtons = bench_logs.NEWTONS[form.unit or "N"]
        found += [(min(max(level, 0.0), 1.0), at, newtons * v) for v, at in zip(values[1:], columns)]
    return _bench(path, found, remarks)


def _bench(
    path: str, found: Sequence[Tuple[float, Tuple[float, ...], float]], remarks: Sequence[str]
) -> Bench:
    """The Bench of forces with their levels, and the thrusters at work. GroundError where thrust at full
    input does not follow from them."""
    levels = {level for level, *_ in found if level > OFF}
    if not levels:
        raise GroundError("%s: a fit needs a force at an input above zero" % path)
    if len(levels) == 1 and min(levels) < 1 - 1e-6:
        raise GroundError(
            "%s: there are forces at the input %g only, so that thrust at full input would be a guess: "
            "measure others; for an on-off thruster, --inputs says which value is on" % (path, min(levels))
        )
    seen: "CounterType[Tuple[float, ...]]" = Counter()
    repetition = []
    for level, at, _ in found:
        repetition.append(seen[(level, *at)])
        seen[(level, *at)] += 1
    inputs, together, forces = (np.array(column) for column in zip(*found))
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


def _columns(path: str, header: Sequence[str], form: BenchFormat) -> List[Tuple[float, ...]]:
    """For each column of forces how many times each thruster is at work."""
    names, measured = form.names, form.together
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


# Rows that were computed


def draft(levels: Sequence[Tuple[float, float]]) -> str:
    """Text of a table for read(), with the inputs of levels (pairs left, right; 0..1) and without
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


def without_copies(
    path: str, rows: Sequence[Row], columns: Sequence[Tuple[float, ...]], off: float = 0.0
) -> Tuple[List[Row], List[str]]:
    """The rows that are not computed from one with a larger input, and a sentence for each that is. columns:
    which thrusters are at work in each column of forces; off: input that means 0."""
    shifted = [(line, [values[0] - off, *values[1:]]) for line, values in rows]
    by_input = sorted((row for row in shifted if row[1][0] != 0), key=lambda row: -abs(row[1][0]))
    pairs = max(1, len(by_input) * (len(by_input) - 1) // 2)
    copies, remarks = set(), []
    for number, (line, values) in enumerate(by_input):
        for other_line, other in by_input[:number]:
            scatter = _scatter(np.array(other[1:]), columns)
            if other_line in copies or other[0] == values[0] or not scatter > 0:
                continue
            factor, chance = _factor(values, other, scatter)
            if chance < LEVEL / pairs:
                copies.add(line)
                remarks.append(
                    "%s: line %d is left out: its forces equal line %d times %.4g, in all %d columns "
                    "and to the last digit, where repetitions differ by %.2g%%: they were computed, not "
                    "measured" % (path, line, other_line, factor, len(columns), 100 * scatter)
                )
                break
    return [row for row in rows if row[0] not in copies], remarks


def _scatter(forces: Array, columns: Sequence[Tuple[float, ...]]) -> float:
    """Relative standard deviation of forces of the same thrusters; nan without repetitions."""
    squares, freedom = 0.0, 0
    for kind in set(columns):
        same = forces[[column == kind for column in columns]]
        if len(same) > 1 and same.mean() != 0:
            squares += float(((same / same.mean() - 1) ** 2).sum())
            freedom += len(same) - 1
    return float(np.sqrt(squares / freedom)) if freedom else float("nan")


def _factor(values: Sequence[float], other: Sequence[float], scatter: float) -> Tuple[float, float]:
    """The factor between two rows, and the probability that measured rows agree as well with it: 1 without
    any."""
    one, two = np.array(values[1:]), np.array(other[1:])
    rounding = np.array([_rounding(v) for v in values[1:]]), np.array([_rounding(v) for v in other[1:]])
    if len(one) < 3 or (one <= rounding[0]).any() or (two <= rounding[1]).any():
        return 1.0, 1.0
    low, high = (one - rounding[0]) / (two + rounding[1]), (one + rounding[0]) / (two - rounding[1])
    if low.max() > high.min():
        return 1.0, 1.0
    width = (high - low) / (one / two)
    typical = 2.5 * scatter  # width of a normal density that has its height
    chance = float(np.prod(np.minimum(1.0, np.sort(width)[1:] / typical)))
    by_inputs = values[0] / other[0]
    if low.max() <= by_inputs <= high.min():
        return by_inputs, chance * min(1.0, float(width.min()) / (typical / np.sqrt(len(one))))
    return float((low.max() + high.min()) / 2), chance


def _rounding(value: float) -> float:
    """Half of the last digit of a number."""
    text = repr(float(value))
    mantissa, _, exponent = text.partition("e")
    return 0.5 * 10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2].rstrip("0")))
