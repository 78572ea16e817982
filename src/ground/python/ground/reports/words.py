"""Numbers, lists and sentences as text."""

import math
import shlex
from dataclasses import astuple
from typing import Iterable, List, Optional, Union

from ground.analysis.horizon import PoseError, PredictionChange, PredictionError
from ground.models import Parameter
from ground.support import quantities
from ground.support.headline import Line

# Least ratio to the noise floor from which more acts than the model has: above the scatter of
# some seven independent predictions
MORE_ACTS = 2.0
SAME_CHANGE = 0.1  # largest difference of two relative changes that count as the same
OTHER_UNIT = 2.0  # least ratio of two units of length that are confused: in and cm are 2.54
LEAST = 1e-9  # error that is as good as none [mm], [deg]


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


def off(error: Union[PoseError, PredictionChange]) -> str:
    """How far predicted poses are off: "56 mm, 16 deg"."""
    if not math.isfinite(error.position_mm + error.heading_deg):
        return "not finite"
    return "%s, %s deg" % (millimetres(error.position_mm), two_digits(error.heading_deg))


def millimetres(value: float) -> str:
    """A length in mm, from 1 m on in m, with two digits."""
    return two_digits(value) + " mm" if value < 999.5 else two_digits(1e-3 * value) + " m"


def two_digits(value: float) -> str:
    """At least two digits, and all before the point."""
    return "%.0f" % value if value >= 99.5 else "%.2g" % value


def after(seconds: float) -> str:
    """The label of predictions: "Prediction after 1 s"."""
    return "Prediction after %.3g s" % seconds


def prediction(found: Optional[PredictionError], first: str, last: str, **beside: str) -> List[Line]:
    """The line on how far predicted poses are off with the models `first` and `last`; beside: words for
    others of the models. Nothing where runs are too short."""
    if found is None:
        return []
    notes = [least(found.errors[last], found.mocap)]
    if found.disturbed and is_pushed(found):
        notes.append("with the random disturbance: " + off(found.disturbed))
    notes += [
        "%s: %s" % (words, off(found.errors[name])) for name, words in beside.items() if name in found.errors
    ]
    shown = " -> ".join(off(found.errors[name]) for name in dict.fromkeys((first, last)))
    return [(after(found.seconds), "%s (%s)" % (shown, "; ".join(notes)))]


def least(error: PoseError, mocap: PoseError) -> str:
    """The noise floor, to be read behind the error of a model: "noise floor: 3.6 mm, 0.81 deg", or that the
    model's error is at it."""
    return "%s: %s" % (quantities.beside_mocap(astuple(error), astuple(mocap)), off(mocap))


def is_pushed(found: PredictionError) -> bool:
    """Whether a random disturbance of the size that the likelihood found, if it did, leaves clearly more than
    the noise floor."""
    disturbed = found.disturbed or found.mocap
    return not quantities.is_as_mocap(astuple(disturbed), astuple(found.mocap))


def more_acts(found: Optional[PredictionError], name: str, finds: str, how: str = "") -> str:
    """What to do if the errors of predicted poses clearly exceed the noise floor, else nothing. finds: the
    command that finds what is missing; how: which runs it takes."""
    ratio = times_the_mocap(found, name)
    if not ratio > MORE_ACTS:
        return ""
    return (
        "prediction errors are %s times the noise floor: an effect is missing, or a random "
        "disturbance acts. To find out which%s:\n%s" % (two_digits(ratio), how, finds)
    )


def unit_of_length(parameters: Iterable[Parameter]) -> str:
    """Why positions are perhaps in another unit than they were read in, else nothing. Motion alone does not
    show it, the given model does: positions that are s times too large give s times the true k, I_z and N_r,
    and the true X_u and Y_v."""
    known = {p.name: p for p in parameters if p.identified and p.start and p.value / p.start > 0}
    if not {"k", "I_z"} <= set(known):
        return ""
    change = {name: math.log(p.value / p.start) for name, p in known.items()}
    by = (change["k"] + change["I_z"]) / 2
    alike = abs(change["k"] - change["I_z"]) < SAME_CHANGE and abs(by) > math.log(OTHER_UNIT)
    scaled = [name for name in ("k", "I_z", "N_r") if name in known]
    kept = [name for name in ("X_u", "Y_v") if name in known]
    if not alike or any(abs(change[name] - by) > abs(by) / 2 for name in scaled):
        return ""
    if not kept or any(abs(change[name]) > abs(by) / 2 for name in kept):
        return ""
    by_factor = "%s are %s times as large as in the given model" % (listed(scaled), two_digits(math.exp(by)))
    others = "%s %s not" % (listed(kept), "are" if len(kept) > 1 else "is")
    wrong = "if it is a model of this craft, positions were read in a wrong unit"
    return "%s, %s: %s" % (by_factor, others, wrong)


def diagnosing(model: str, written: str, is_held_out: bool = False) -> str:
    """The command that finds what is missing in a model, by its name in Python or by its file. is_held_out:
    the recordings at hand only test it; the search uses the recordings of the model's fit."""
    if not written:
        runs = "FITTED_RECORDINGS, holdout=RECORDINGS" if is_held_out else "RECORDINGS"
        return "ground.diagnose(%s, %s)" % (model, runs)
    runs = "FITTED_BAGS --holdout BAGS" if is_held_out else "BAGS"
    return "rosrun ground identify diagnose %s --model %s -o diagnosis" % (runs, shlex.quote(written))


def times_the_mocap(found: Optional[PredictionError], name: str) -> float:
    """Ratio of a model's error of predicted poses to the noise floor; not a number where it is not known."""
    if found is None:
        return math.nan
    error, least = found.errors[name], found.mocap
    return max(
        error.position_mm / max(least.position_mm, LEAST), error.heading_deg / max(least.heading_deg, LEAST)
    )


def ratio(larger: PoseError, smaller: PoseError) -> float:
    """Ratio of two errors of predicted poses: the geometric mean of position and heading."""
    position = larger.position_mm / max(smaller.position_mm, LEAST)
    return math.sqrt(position * larger.heading_deg / max(smaller.heading_deg, LEAST))
