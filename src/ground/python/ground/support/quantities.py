"""Numbers with their units, in words."""

import math
import re
from typing import Optional, Tuple

import numpy as np


def quantity(value: float, unit: str, digits: int = 3) -> str:
    """A number with its unit; a small one has the prefix milli if the unit allows it."""
    factor, unit = _scale(value, unit)
    return ("%.*g %s" % (digits, factor * value, unit)).rstrip(" -")


def with_interval(
    value: float, low: float, high: float, unit: str, runs: Optional[Tuple[float, float]] = None
) -> str:
    """A number with its 95% interval, as precise as the interval: "50.02 ms (95%: 49.98 to 50.05 ms)". runs:
    the least and the largest of runs that differ."""
    factor, unit = _scale(value, unit)
    half = factor * max(high - value, value - low)
    places = 3 if not 0 < half < math.inf else int(np.clip(-math.floor(math.log10(half)), 0, 9))
    if runs and factor * value:  # the interval may be wide: at least two digits of the value
        places = max(places, int(np.clip(1 - math.floor(math.log10(abs(factor * value))), 0, 9)))
    numbers = [value, low, high, *(runs or ())]
    told = ["%.*f" % (places, round(factor * number, places) + 0.0) for number in numbers]
    unit = " " + unit if unit not in ("", "-") else ""
    differ = "; runs differ: %s to %s%s" % (told[3], told[4], unit) if runs else ""
    return "%s%s (95%%: %s to %s%s%s)" % (told[0], unit, told[1], told[2], unit, differ)


def _scale(value: float, unit: str) -> Tuple[float, str]:
    """The factor and the unit with which a value is easy to read: the prefix milli if it is small."""
    unit = re.sub(r"/\((.*)\)$", r" per \1", unit)
    if 0 < abs(value) < 0.1 and (unit in ("s", "m", "rad") or unit.startswith("N")):
        return 1e3, "m" + unit
    return 1.0, unit
