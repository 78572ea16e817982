"""Which features name what is learnable: those whose formulas mean something by themselves."""

from typing import List, Optional, Sequence

import numpy as np

from ground.analysis.distributions import chi_squared_above
from ground.analysis.regression import LEVEL, Regression, Term
from ground.annotations import Flags

MOST = 5  # features of a formula
MIN_RATIO = 12.0  # of the likelihoods with and without a feature
EXPLAINED = 0.98  # part of the terms' gain from which a formula needs no further feature


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
        j = regression.plainest(int(np.argmax(np.where(z > 0, z - 2 * np.log(regression.tried), -np.inf))), z)
        if chi_squared_above(float(z[j]), 1) * regression.tried[j] > LEVEL:
            break
        term = regression.test(np.array([j]), [*beside, *terms], "feature %d" % j)
        if term.ratio < max(MIN_RATIO, (1 - EXPLAINED) * sum(t.ratio for t in terms)):
            break
        terms.append(term)
    return terms
