"""Statistics behind the analysis, against plain references and scipy.stats."""

import numpy as np
import pytest
from scipy import stats

from conftest import MODEL, run_data
from ground import _core
from ground.analysis import evidence, window_error


def model():
    return _core.load_model(str(MODEL))


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


def test_an_artificial_recording_has_the_noise_and_the_motion_of_the_model():
    run, craft = run_data(6.0, noise=0), model()
    found = window_error.recorded(run, craft, np.random.default_rng(1))
    first = np.array(run.eta)[0], np.array(run.nu)[0]
    true = _core.simulate(craft, np.array(run.inputs), np.array(run.times), *first)["eta"]
    off = np.array(found.poses) - true
    assert np.allclose(off.std(axis=0), np.array(run.noise), rtol=0.15)
    pushed = window_error.recorded(
        run, craft, np.random.default_rng(1), np.tile([0.01, 0, 0], (len(run.times), 1)), 0.1
    )
    assert np.abs(np.array(pushed.poses) - np.array(found.poses))[:, :2].max() > 0.05
    assert np.array_equal(np.array(found.times), np.array(run.times))
    floor = window_error.noise_floor([run], craft)
    assert (floor > 0).all() and (floor < 0.2).all()
    assert np.array_equal(floor, window_error.noise_floor([run], craft, 1))
    assert not np.array_equal(floor, window_error.noise_floor([run], craft, 2))
