"""Statistics behind the analysis, against plain references and scipy.stats."""

import numpy as np
import pytest
from scipy import stats

from ground.analysis import evidence

# --- effects on trial


def test_p_values_are_those_of_the_mixture():
    assert evidence.p_value(5.0, 2, 0) == pytest.approx(stats.chi2.sf(5.0, 2))
    assert evidence.p_value(5.0, 1, 1) == pytest.approx(0.5 * stats.chi2.sf(5.0, 1))
    both = 0.5 * stats.chi2.sf(5.0, 1) + 0.25 * stats.chi2.sf(5.0, 2)
    assert evidence.p_value(5.0, 2, 2) == pytest.approx(both)
    one = 0.5 * stats.chi2.sf(5.0, 1) + 0.5 * stats.chi2.sf(5.0, 2)
    assert evidence.p_value(5.0, 2, 1) == pytest.approx(one)
    assert evidence.p_value(0.0, 2, 1) == 1.0 and evidence.p_value(-1.0, 2, 0) == 1.0
    # A simulated parameter that cannot be negative: its ratio is above a value as often.
    draws = np.maximum(np.random.default_rng(1).normal(size=200000), 0) ** 2
    assert evidence.p_value(2.0, 1, 1) == pytest.approx((draws >= 2.0).mean(), rel=0.03)


# --- windows of runs
