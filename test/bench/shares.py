"""Shares of counted cases, with their intervals (Clopper and Pearson 1934)."""

from scipy import stats


def interval(hits, count, level=0.05):
    """Ends of the interval that misses a share in `level` of all cases. Counts may be fractions, such as of
    cases that depend on each other."""
    low = stats.beta.ppf(level / 2, hits, count - hits + 1) if hits > 0 else 0.0
    high = stats.beta.isf(level / 2, hits + 1, count - hits) if hits < count else 1.0
    return float(low), float(high)


def share(hits, count):
    """A share with its 95% interval, as text."""
    ends = [100 * end for end in interval(hits, count)]
    return "%d of %d, %.0f%% (%.0f to %.0f%%)" % (hits, count, 100 * hits / max(count, 1), *ends)
