"""Names of columns and fields in the words of the field: their units, and what they probably are."""

import re
from typing import Dict, FrozenSet, List, Tuple

# By what is written; a unit that mappings know
UNITS: Dict[str, str] = {
    "m": "m", "meter": "m", "meters": "m", "metre": "m", "metres": "m", "cm": "cm", "mm": "mm",
    "millimeters": "mm", "centimeters": "cm", "in": "in", "inch": "in", "inches": "in", "km": "km", "ft": "ft",
    "rad": "rad", "rads": "rad", "radian": "rad", "radians": "rad",
    "deg": "deg", "degs": "deg", "degree": "deg", "degrees": "deg", "°": "deg",
    "s": "s", "sec": "s", "secs": "s", "second": "s", "seconds": "s", "ms": "ms", "msec": "ms",
    "millis": "ms", "milliseconds": "ms", "us": "us", "µs": "us", "μs": "us", "usec": "us", "micros": "us",
    "microseconds": "us", "ns": "ns", "nsec": "ns", "nanos": "ns", "nanoseconds": "ns",
    "%": "%", "percent": "%", "pct": "%", "rpm": "rpm", "rps": "rps", "1/s": "rps", "hz": "rps", "v": "V",
    "n": "N", "g": "g", "m/s": "m/s", "rad/s": "rad/s", "deg/s": "deg/s", "nm": "Nm", "m/s^2": "m/s2", "m/s2": "m/s2",
}  # fmt: skip
IN_NAMES = ("cm", "mm", "km", "ft", "rad", "deg", "degrees", "radians", "sec", "secs", "ms", "msec", "us",
            "usec", "ns", "nsec", "percent", "pct", "m", "s", "in", "rpm", "rps")  # fmt: skip


def unit(text: str) -> str:
    """The unit that a cell is, "[mm]" or "(deg)"; empty: none that is known."""
    bare = text.strip().strip("[](){}").strip()
    return UNITS.get(bare, UNITS.get(bare.lower(), ""))


def unit_in(name: str) -> str:
    """The unit at the end of a name: "x [mm]", "t (s)", "yaw_deg", "stamp_ns"; empty: none."""
    return _parted(name)[1]


def bare(name: str) -> str:
    """A name without its unit."""
    return _parted(name)[0]


def _parted(name: str) -> Tuple[str, str]:
    bracket = re.search(r"\s*[\[({]\s*([^\])}\[({]*?)\s*[\])}]\s*$", name)
    if bracket and not bracket.group(1).isdigit():
        return name[: bracket.start()], unit(bracket.group(1))
    end = re.search(r"(?<=[A-Za-z0-9])(?:[_ .]|\s*/\s*)(%s)$" % "|".join(IN_NAMES), name, re.I)
    if end:
        return name[: end.start()], unit(end.group(1))
    joined = re.search(r"(?<=[a-z])(Deg|Rad|Ms|Ns|Us|Sec|Mm|Cm)$", name)  # yawDeg
    return (name[: joined.start()], unit(joined.group(1))) if joined else (name, "")


def split(name: str) -> List[str]:
    """The words of a name without its unit, in small letters: "poseX" and "pose_x" are pose, x."""
    text = re.sub(r"([a-z])([A-Z])", r"\1 \2", bare(name))
    found = [word.lower() for word in re.findall(r"[A-Za-z]+|\d+", text)]
    return found
