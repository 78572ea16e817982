"""Numbers, lists and sentences as text."""

import math
import re
from typing import List, Mapping, Optional

from ground.support.annotations import Document
from ground.support.headline import Line

# Least ratio to what the mocap alone leaves from which something is missing: above the scatter of some seven
# independent predictions
MISSING = 2.0
MATTERS = 1.2  # least ratio to what the mocap alone leaves at which the random disturbance is named


def number(value: Optional[float]) -> str:
    """Three digits after the point; "-" for None and NaN."""
    return "-" if value is None or math.isnan(value) else "%.3f" % value


def listed(names: List[str]) -> str:
    """ "a", "a and b", "a, b and c"."""
    return " and ".join([", ".join(names[:-1])] * (len(names) > 1) + names[-1:])


def capital(text: str) -> str:
    """A text with a capital letter."""
    return text[:1].upper() + text[1:]


def sentence(text: str) -> str:
    """A text with a capital letter and a full stop."""
    return capital(text.strip()) + ("" if text.rstrip().endswith((".", "!", "?")) else ".")


def off(error: Mapping[str, Optional[float]]) -> str:
    """How far predicted poses are off: "56 mm, 16 deg"."""
    position, heading = error["position_mm"], error["heading_deg"]
    if position is None or heading is None or not math.isfinite(position + heading):
        return "not finite"
    return "%s, %s deg" % (millimetres(position), two_digits(heading))


def millimetres(value: float) -> str:
    """A length in mm, from 1 m on in m, with two digits."""
    return two_digits(value) + " mm" if value < 999.5 else two_digits(1e-3 * value) + " m"


def two_digits(value: float) -> str:
    """At least two digits, and all before the point."""
    return "%.0f" % value if value >= 99.5 else "%.2g" % value


# Effects that are a vector in the room: its components, its unit and what it says
VECTORS = {
    "floor_tilt": ("sx", "sy", "it descends by %s deg"),
    "wind": ("wx", "wy", "it blows at %s m/s"),
    "current": ("wx", "wy", "it flows at %s m/s"),
}


# Effects whose sign is a side: a parameter, and what it means where it is positive. %s: its size in percent
SIDES = {
    "thrust_asymmetry": ("a", "the left side pushes %s more and the right side pushes %s less"),
    "thrust_misalignment": ("angle", "thrust points to the right"),
    "yaw_bias": ("n0", "it turns the craft to the right"),
    "com_offset": ("yg", "the centre of mass is to the right"),
}
OTHER = {"left": "right", "right": "left"}


def direction(effect: str, values: Mapping[str, float], deviations: Mapping[str, float]) -> str:
    """Size and direction of an effect that is a vector in the room, from its parameters and their standard
    deviations: "it descends by 0.023 deg towards 135 deg (95%: 8 deg either way; 0: the room's x, 90: its
    y)"; which side is meant by the sign of one in SIDES; empty for others."""
    if effect in SIDES:
        name, told = SIDES[effect]
        if values[name] < 0:
            told = re.sub("left|right", lambda side: OTHER[side.group()], told)
        percent = two_digits(100 * abs(values[name])) + "%"
        return told.replace("%s", percent) if abs(values[name]) > 1.96 * deviations[name] else ""
    if effect not in VECTORS:
        return ""
    first, second, text = VECTORS[effect]
    x, y = values[first], values[second]
    size = math.hypot(x, y)
    if not size > 0:
        return ""
    # across the vector, without the correlation of its components
    across = math.hypot(y * deviations[first], x * deviations[second]) / size
    either_way = math.degrees(1.96 * across / size)
    shown = math.degrees(math.atan(size)) if effect == "floor_tilt" else size
    told = text % two_digits(shown)
    if not either_way < 90:
        return told + " in a direction that these runs do not show"
    angle = round(math.degrees(math.atan2(y, x))) or 0  # no "-0"
    return "%s towards %d deg (95%%: %s deg either way; 0: the room's x, 90: its y)" % (
        told, angle, two_digits(either_way),
    )  # fmt: skip


def after(found: Document) -> str:
    """The label of predictions: "Prediction after 1 s"."""
    return "Prediction after %.3g s" % found["seconds"]


def prediction(found: Optional[Document], first: str, last: str, **beside: str) -> List[Line]:
    """The line on how far predicted poses are off with the models `first` and `last` of a
    horizon.PredictionError, as a dictionary; beside: words for others of its models. Nothing where runs are
    too short."""
    if found is None:
        return []
    errors = found["errors"]
    notes = [("the mocap alone", found["mocap"])]
    if found["disturbed"] and any(
        (found["disturbed"][key] or 0) > MATTERS * (found["mocap"][key] or 0) for key in found["mocap"]
    ):
        notes.append(("with the random disturbance", found["disturbed"]))
    notes += [(words, errors[name]) for name, words in beside.items() if name in errors]
    shown = " -> ".join(off(errors[name]) for name in dict.fromkeys((first, last)))
    told = "; ".join("%s: %s" % (what, off(error)) for what, error in notes)
    return [(after(found), "%s (%s)" % (shown, told))]


def times_the_mocap(found: Optional[Document], name: str) -> float:
    """How many times what the mocap alone leaves a model's predicted poses are off; not a number where it is
    not known."""
    if found is None:
        return math.nan
    error, least = found["errors"][name], found["mocap"]
    return max(ratio({key: error[key]}, {key: least[key]}) for key in least)


def ratio(larger: Mapping[str, Optional[float]], smaller: Mapping[str, Optional[float]]) -> float:
    """Ratio of two errors of predicted poses: the geometric mean of position and heading."""
    ratios = [
        (math.inf if larger[key] is None else larger[key]) / max(smaller[key] or 0.0, 1e-9)  # type: ignore
        for key in larger
    ]
    return float(math.prod(ratios) ** (1 / len(ratios)))
