"""Distributions of test statistics, by scipy.special: scipy.stats takes five times as long to load."""

import math

from scipy import special

from ground.support.annotations import Array


def chi_squared_above(value: float, freedom: int) -> float:
    """Probability that a chi squared variable exceeds a value."""
    return float(special.chdtrc(freedom, value)) if value > 0 else 1.0


def chi_squared_limit(chance: float, freedom: int) -> float:
    """Value that a chi squared variable exceeds with a probability."""
    return float(special.chdtri(freedom, chance))


def student_limit(chance: float, freedom: int) -> float:
    """Value that Student's t exceeds with a probability."""
    return float(special.stdtrit(freedom, 1 - chance))


def heads(count: int, tosses: int) -> float:
    """Probability of `count` heads in some tosses of a coin."""
    return math.comb(tosses, count) / 2.0**tosses


def mean_not_above_zero(values: Array) -> float:
    """p-value of the t-test that the mean of a population is not above zero, by a sample (n,); 1 where a
    single value, or equal ones, do not allow it."""
    spread = values.std(ddof=1) if len(values) > 1 else 0.0
    if not spread > 0:
        return 1.0
    return float(special.stdtr(len(values) - 1, -values.mean() / spread * math.sqrt(len(values))))


def normal_limit(chance: float) -> float:
    """Value that a standard normal variable exceeds with a probability."""
    return float(special.ndtri(1 - chance))
