"""Distributions of test statistics, by scipy.special: scipy.stats takes five times as long to load."""

import math
from typing import List, Tuple

import numpy as np
from scipy import special

from ground.support.annotations import Array, Indices

LEVEL = 0.01  # probability of a false finding, over all findings that are tested together
DEVIATIONS = 1.96  # standard deviations on each side of a 95% interval of a normal variable
PIECES = 8  # least number of pieces of data that an interval of a mean is taken from


def chi_squared_above(value: float, freedom: int) -> float:
    """Probability that a chi squared variable exceeds a value."""
    return float(special.chdtrc(freedom, value)) if value > 0 else 1.0


def chi_squared_limit(chance: float, freedom: int) -> float:
    """Value that a chi squared variable exceeds with a probability."""
    return float(special.chdtri(freedom, chance))


def student_limit(chance: float, freedom: float) -> float:
    """Value that Student's t exceeds with a probability."""
    return float(special.stdtrit(freedom, 1 - chance))


def mean_not_above_zero(values: Array) -> float:
    """p-value of the t-test that the mean of a population is not above zero, by a sample (n,); 1 where a
    single value, or equal ones, do not allow it."""
    spread = values.std(ddof=1) if len(values) > 1 else 0.0
    if not spread > 0:
        return 1.0
    return float(special.stdtr(len(values) - 1, -values.mean() / spread * math.sqrt(len(values))))


def pieces_of(part_of: Indices) -> List[Indices]:
    """Pieces of data that are independent, although neighbours are alike: parts, such as runs, or where there
    are fewer than PIECES, equal pieces of them. part_of: (n,) the part of each value."""
    parts = [np.flatnonzero(part_of == part) for part in np.unique(part_of)]
    each = max(1, -(-PIECES // len(parts)))
    return [piece for part in parts for piece in np.array_split(part, each) if len(piece)]


def ratio_of_means(after: Array, before: Array, weights: Array, part_of: Indices) -> Tuple[float, float]:
    """95% interval of the ratio of the weighted means of two or more paired values (n,): of its logarithm, by
    Student's t over pieces of data. part_of: (n,) the part of the data that each pair is in."""
    pieces = pieces_of(part_of)
    sums = np.array([[weights[p] @ values[p] for p in pieces] for values in (after, before)])
    ratio = float(sums[0].sum() / sums[1].sum())
    varying = np.subtract(*(sums / sums.mean(axis=1, keepdims=True)))
    deviation = varying.std(ddof=1) / math.sqrt(len(pieces))
    factor = math.exp(student_limit(0.025, len(pieces) - 1) * deviation)
    return ratio / factor, ratio * factor


def student_outside(value: float, freedom: float = math.inf) -> float:
    """Probability that Student's t, or a standard normal variable, is further from zero."""
    return float(2 * special.stdtr(freedom, -abs(value)))


def chance_by_interval(value: float, ci95: Tuple[float, float], neutral: float) -> float:
    """Probability of an estimate so far from a neutral value, as of a normal variable with the half of the
    95% interval that is on the neutral side. If the neutral value is infinite, reciprocals are compared."""
    (value, *ends), off = (value, *ci95), neutral
    if math.isinf(neutral):
        (value, *ends), off = (1 / x if x else math.inf for x in (value, *ends)), 0.0
    half = max((abs(value - end) for end in ends if (end - value) * (off - value) > 0), default=0.0)
    if value == off:
        return 1.0
    return student_outside(DEVIATIONS * abs(value - off) / half) if half else 0.0


def normal_limit(chance: float) -> float:
    """Value that a standard normal variable exceeds with a probability."""
    return float(special.ndtri(1 - chance))
