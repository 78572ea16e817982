"""What is known of a model's parameters before a fit."""

import argparse
import math
from typing import Dict, Iterator, List, Mapping, Sequence, Tuple, Union

from ground import _core
from ground.analysis.distributions import LEVEL, student_outside
from ground.effect_library.parameters import described
from ground.models import Parameter
from ground.support.errors import GroundError

Known = Dict[str, Tuple[float, float]]  # mean and standard deviation by parameter
Given = Union[Mapping[str, Union[float, str]], Sequence[Tuple[str, Union[float, str]]]]
TOLD_LITTLE = 0.9  # of the deviation that was known, left after a fit
SHOWN = 8  # parameters of a sentence


def parse(text: str) -> Tuple[str, str]:
    """A NAME=DEVIATION of a command line. Raises argparse.ArgumentTypeError on another text."""
    name, equals, deviation = text.partition("=")
    if not (name and equals and deviation):
        raise argparse.ArgumentTypeError("%s is not NAME=DEVIATION, such as k=0.01 or hull_lift=20%%" % text)
    return name, deviation


def known(model: _core.Model, given: Given) -> Known:
    """The model's values as means, and their deviations. An effect stands for all its parameters.

    given: a deviation in the parameter's unit, or a share of its value such as "20%", by the name of a
    parameter or an effect. Raises GroundError on an unknown name and on a deviation that is not above 0.
    """
    found: Known = {}
    names = list(described(model))
    for name, deviation in dict(given).items():
        chosen = [n for n in names if n == name or n.split(".")[0] == name]
        if not chosen:
            raise GroundError(
                "prior of %s: the model has no such parameter or effect; it has %s" % (name, ", ".join(names))
            )
        for one in chosen:
            found[one] = (model.value(one), _deviation(one, model.value(one), deviation))
    return found


def _deviation(name: str, value: float, given: Union[float, str]) -> float:
    text = str(given).strip()
    share = text.endswith("%")
    try:
        number = float(text.rstrip("%"))
    except ValueError:
        raise GroundError("prior of %s: %s is neither a number nor a share such as 20%%" % (name, given))
    if share and value == 0:
        raise GroundError(
            "prior of %s: its value is 0, and so is %s of it; give the deviation in its unit" % (name, text)
        )
    found = abs(value) * number / 100 if share else number
    if not 0 < found < math.inf:
        raise GroundError("prior of %s: a standard deviation must be above 0, not %s" % (name, given))
    return found


def sentences(before: Known, parameters: Mapping[str, Parameter]) -> Iterator[str]:
    """What runs say of parameters that were known, in words. parameters: of a fit."""
    contradicted: List[str] = []
    told_little: List[str] = []
    for name, p in parameters.items():
        if name not in before:
            continue
        mean, deviation = before[name]
        if len(before) * contradiction(p.value - mean, deviation, p.deviation) < LEVEL:
            contradicted.append("%s (prior %.3g ± %.2g, now %.3g)" % (name, mean, deviation, p.value))
        elif p.deviation > TOLD_LITTLE * deviation:
            told_little.append(name)
    if contradicted:
        yield "the runs contradict the prior of %s" % _listed(contradicted)
    if told_little:
        yield "the runs barely determine %s: the prior decides" % _listed(told_little)


def contradiction(moved: float, before: float, after: float) -> float:
    """Probability that a fit moves a parameter further from what was known, if that is right (Box 1980: the
    variance of the move is what runs take from the prior variance, at least what TOLD_LITTLE leaves)."""
    told = 1 - min(after / before, TOLD_LITTLE) ** 2
    return student_outside(moved / (before * math.sqrt(told)))


def _listed(names: Sequence[str]) -> str:
    more = len(names) - SHOWN
    return ", ".join(names[:SHOWN]) + (" and %d more" % more if more > 0 else "")
