"""Properties of small functions of ground.poses and ground.analysis, each with plain numbers."""

import numpy as np
import pytest

from ground.analysis import tracks
from ground.fitting import identifiability
from ground.models import Parameter

# --- tracking


def test_a_track_counts_what_is_after_its_settling():
    times = np.arange(100) / 10
    eta = np.zeros((100, 3))
    reference = np.where(times < 5, 1.0, 0.1)[:, None] * [1.0, 0.0]
    inputs = np.column_stack([times, np.where(times < 5, 1.0, 0.5), np.full(100, 0.5)])
    wanted = np.column_stack([times, np.where(times < 5, 3.0, 0.5), np.full(100, 0.5)])
    computing = np.column_stack([times, 1e-3 * (1 + np.arange(100))])
    track = tracks.Track(times, eta, reference, inputs, wanted, computing, "", 0.0)
    early, late = tracks.numbers(track), tracks.numbers(track, 5.0)
    assert late["rms"] == pytest.approx(0.1) and late["final"] == pytest.approx(0.1)
    assert early["max"] == pytest.approx(1.0) and late["max"] == pytest.approx(0.1)
    assert early["saturated_fraction"] == 0.5 and late["saturated_fraction"] == 0
    assert early["effort"] == pytest.approx((1 + 0.25 + 0.25 + 0.25) / 4)
    assert late["effort"] == pytest.approx(0.25)
    assert early["wanted_largest"] == 3 and late["wanted_largest"] == 0.5
    assert early["wanted_outside"] == 0.5 and late["wanted_outside"] == 0
    assert late["compute_ms"]["max"] == pytest.approx(100)
    assert late["compute_ms"]["median"] == pytest.approx(50.5)


# --- windows and thinning


# --- poses


# --- words on fits


def fit_of(values, deviations, correlation):
    parameters = {
        name: Parameter(name, "", value, value, (value - 2 * d, value + 2 * d), d, False, True)
        for (name, value), d in zip(values.items(), deviations)
    }
    return identifiability.WindowEstimates(None, parameters, np.array(correlation), 10.0)


def test_only_ratio_or_product_of_a_weak_pair_is_known():
    high = [[1, 0.99], [0.99, 1]]
    (weak,) = identifiability.weak_directions(fit_of({"k": 2.0, "m": 4.0}, [0.4, 0.8], high))
    assert weak.known_as == "k/m" and weak.parameters == ["k", "m"]
    assert weak.deviation == pytest.approx(0.2 * np.sqrt(2 * 0.01))
    assert weak.deviations == pytest.approx([0.2, 0.2])
    assert weak.strength == pytest.approx(1 / np.sqrt(0.02))
    low = [[1, -0.99], [-0.99, 1]]
    (weak,) = identifiability.weak_directions(fit_of({"k": 2.0, "m": 4.0}, [0.4, 0.8], low))
    assert weak.known_as == "k*m"
    draws = np.random.default_rng(1).multivariate_normal([2, 4], [[1e-4, -1.98e-4], [-1.98e-4, 4e-4]], 20000)
    product = draws.prod(axis=1)  # of a fortieth of the doubt: there, logarithms are linear
    assert product.std() / product.mean() == pytest.approx(weak.deviation / 40, rel=0.05)
    # A negative value turns the sense of the correlation round.
    (weak,) = identifiability.weak_directions(fit_of({"k": -2.0, "m": 4.0}, [0.4, 0.8], low))
    assert weak.known_as == "k/m"
    assert not identifiability.weak_directions(fit_of({"k": 2, "m": 4}, [0.4, 0.8], np.eye(2)))
    assert not identifiability.weak_directions(fit_of({"k": 2, "m": 4}, [0.02, 0.04], high))
