"""Numbers with their units, in words."""

import math
import re
from typing import Iterable, List, Optional, Tuple

SCATTER = 1.2  # least ratio of errors of predicted poses that is not scatter over few predictions


def quantity(value: float, unit: str, digits: int = 3) -> str:
    """A number with its unit; a small one has the prefix milli if the unit allows it."""
    factor, unit = _scale(value, unit)
    return ("%.*g %s" % (digits, factor * value, unit)).rstrip(" -")


def with_interval(
    value: float, low: float, high: float, unit: str, runs: Optional[Tuple[float, float]] = None
) -> str:
    """A number with its 95% interval, as precise as the interval: "50.018 ms (95%: 49.984 to 50.052 ms)".
    runs: the least and the largest of runs that differ."""
    factor, unit = _scale(value, unit)
    told = same_decimals(*(factor * number for number in (value, low, high, *(runs or ()))))
    unit = " " + unit if unit not in ("", "-") else ""
    differ = "; runs differ: %s to %s%s" % (told[3], told[4], unit) if runs else ""
    return "%s%s (95%%: %s to %s%s%s)" % (told[0], unit, told[1], told[2], unit, differ)


def is_as_mocap(error: Iterable[Optional[float]], mocap: Iterable[Optional[float]]) -> bool:
    """Whether an error of predicted poses (position, heading) is at the noise floor, within its
    scatter over few predictions; None: infinite. No error is at a floor that is not finite."""
    pairs = [(e, m) for e, m in zip(error, mocap) if e is not None and m is not None and m < math.inf]
    return len(pairs) == 2 and all(e <= SCATTER * m for e, m in pairs)


def beside_mocap(error: Iterable[Optional[float]], mocap: Iterable[Optional[float]]) -> str:
    """The words for the noise floor behind a model's error."""
    return "at the noise floor" if is_as_mocap(error, mocap) else "noise floor"


def same_decimals(value: float, low: float, high: float, *others: float) -> List[str]:
    """A number, the ends of its interval and other numbers with the same decimals, as two digits of the
    interval's larger half need them, "0.062010", "0.062005", "0.062015". Small numbers have one exponent."""
    halves = [half for half in (high - value, value - low) if 0 < half < math.inf]
    last = _exponent(max(halves)) - 1 if halves else _exponent(value) - 2
    if others:  # the interval may be wide: at least two digits of the value
        last = min(last, _exponent(value) - 1)
    numbers = (value, low, high, *others)
    first = _exponent(max((abs(n) for n in numbers if math.isfinite(n)), default=0.0))
    power = first if first < -4 else 0
    places, suffix = max(0, power - last), "e%03d" % power if power else ""
    return [
        "%.*f%s" % (places, round(number * 10.0**-power, places) + 0.0, suffix) if math.isfinite(number)
        else "%f" % number for number in numbers
    ]  # fmt: skip


def _exponent(value: float) -> int:
    """The place of the first digit of a number; 0 for 0."""
    return math.floor(math.log10(abs(value))) if value and math.isfinite(value) else 0


def _scale(value: float, unit: str) -> Tuple[float, str]:
    """The factor and the unit with which a value is easy to read: the prefix milli if it is small."""
    unit = re.sub(r"/\((.*)\)$", r" per \1", unit)
    if 0 < abs(value) < 0.1 and (unit in ("s", "m", "rad") or unit.startswith("N")):
        return 1e3, "m" + unit
    return 1.0, unit
