"""Shares of counted cases, with their uncertainty."""

import math


def share(hits, count, z=1.96):
    """A share with its 95% interval (Wilson 1927), as text."""
    if not count:
        return "0 of 0"
    rate, unit = hits / count, z * z / count
    middle, half = rate + unit / 2, z * math.sqrt(rate * (1 - rate) / count + unit / (4 * count))
    ends = [100 * (middle + side * half) / (1 + unit) for side in (-1, 1)]
    return "%d of %d, %.0f%% (%.0f to %.0f%%)" % (hits, count, 100 * rate, *ends)
