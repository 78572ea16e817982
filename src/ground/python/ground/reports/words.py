"""Numbers, lists and sentences as text."""

import math
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
