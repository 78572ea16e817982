"""Which features name what is learnable: those whose formulas mean something by themselves."""

import re
from typing import List, Optional, Sequence

import numpy as np

from ground.analysis.dictionary import Feature
from ground.analysis.distributions import chi_squared_above
from ground.analysis.regression import LEVEL, Regression, Term
from ground.annotations import Flags

MOST = 5  # features of a formula
MIN_RATIO = 12.0  # of the likelihoods with and without a feature
EXPLAINED = 0.97  # part of the terms' gain from which a formula needs no further feature
CONSTANT = re.compile(r"\{\w+\}|(?<=[a-z])\d+")  # in a formula; or the number in a state's name
POWER = re.compile(r"(\w+)\^([23])")


def chosen(
    regression: Regression, among: Optional[Flags] = None, beside: Sequence[Term] = ()
) -> List[Term]:
    """Significant single features that mean something, each beside those before it and beside other
    terms. among: features that may be chosen, by default all."""
    allowed = np.array([f.family.named for f in regression.features])
    if among is not None:
        allowed &= among
    terms: List[Term] = []
    while len(terms) < MOST:
        z = np.where(allowed, regression.significance([*beside, *terms]), 0.0)
        j = int(np.argmax(np.where(z > 0, z - 2 * np.log(regression.tried), -np.inf)))
        if chi_squared_above(float(z[j]), 1) * regression.tried[j] > LEVEL:
            break
        term = regression.test(np.array([j]), [*beside, *terms], "feature %d" % j)
        if term.ratio < max(MIN_RATIO, (1 - EXPLAINED) * sum(t.ratio for t in terms)):
            break
        terms.append(term)
    return terms


def dependence(feature: Feature) -> str:
    """What a feature has in common with those that differ in their constants, or in how their formulas
    are written."""
    parts = []
    for channel, text in sorted(feature.template.items()):
        text = CONSTANT.sub("", text)
        text = POWER.sub(lambda found: "*".join([found.group(1)] * int(found.group(2))), text)
        factors = sorted(f for f in re.sub("[()]", "", text).split("*") if f)
        parts.append("%s: %s" % (channel, "*".join(factors)))
    return ", ".join(parts)
