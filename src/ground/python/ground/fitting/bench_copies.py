"""Rows of a table of forces that were not measured, but computed from another row.

Measured repetitions scatter. Where the forces at one input are those at another one times a factor, in all
columns and to the last digit, they were computed: such a row says nothing of the curve.
"""

from typing import List, Sequence, Tuple

import numpy as np

from ground.support.annotations import Array

CHANCE = 0.01  # that a row which was measured is taken for a computed one, over all pairs of rows

Row = Tuple[int, List[float]]  #: line, and the numbers: input, then forces


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
            if chance < CHANCE / pairs:
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
