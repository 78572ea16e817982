"""Properties of small functions of ground.recordings and ground.analysis, each with plain numbers."""

import numpy as np
import pytest

from ground import _core
from ground.analysis import thinning
from ground.fitting import identifiability
from ground.recordings import scatter, tracks

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


def test_thinning_averages_neighbours_and_never_across_a_gap():
    times = np.arange(400) / 210.0
    times[200:] += 0.5
    eta = np.column_stack([times, times**2, np.sin(times)])
    inputs = np.array([[0.0, 0.5, 0.5, 1.0]])
    run = _core.RunData("run", times, eta, 2 * eta, inputs, 3 * eta, np.array([1e-3, 1e-3, 4e-3]))
    thin = thinning.thinned(run)
    assert len(thin.times) == 100  # four of 210 Hz are 52 Hz
    groups = times.reshape(100, 4)
    assert np.allclose(thin.times, groups.mean(axis=1))
    assert np.allclose(thin.eta, eta.reshape(100, 4, 3).mean(axis=1))
    assert np.allclose(thin.nu, 2 * np.array(thin.eta))
    assert np.allclose(thin.poses, 3 * np.array(thin.eta))
    assert np.allclose(thin.noise, [5e-4, 5e-4, 2e-3])
    odd = _core.RunData("run", times[3:], eta[3:], eta[3:], inputs)
    apart = np.array(thinning.thinned(odd).times)
    assert not ((apart > times[199]) & (apart < times[200])).any()  # no mean of both sides of the gap
    slow = _core.RunData("run", 3 * times[:150], eta[:150], eta[:150], inputs)
    assert thinning.thinned(slow).times.tolist() == slow.times.tolist()
    assert len(thinning.thinned(thin).times) == len(thin.times)


@pytest.mark.parametrize("acceleration", [0.002, 0.05, 2.0])
def test_slow_craft_are_thinned_as_far_as_the_noise_hides_the_error_of_means(acceleration):
    times = np.arange(1200) / 120.0
    rate = 2.0  # of a swinging motion [rad/s]
    eta = np.column_stack([acceleration / rate**2 * np.sin(rate * times), 0 * times, 0 * times])
    nu = np.column_stack([acceleration / rate * np.cos(rate * times), 0 * times, 0 * times])
    noise, inputs = np.array([2e-5, 2e-5, 1e-4]), np.array([[0.0, 0.5, 0.5, 1.0]])
    scales = _core.RunScales(window=15.0)
    thin = thinning.thinned(_core.RunData("run", times, eta, nu, inputs, eta, noise, scales=scales))
    exact = acceleration / rate**2 * np.sin(rate * np.array(thin.times))
    step = np.median(np.diff(thin.times))
    assert 1 / 60 - 1e-9 <= step <= 0.2 + 1e-9  # as a palm-sized craft, or a tenth of its rate
    if step > 1 / 50:
        assert np.abs(np.array(thin.eta)[:, 0] - exact).max() < 0.21 * noise[0]
    assert (step < 0.02) == (acceleration == 2.0) and (step > 0.15) == (acceleration == 0.002)
    assert thinning.thinned(thin) is thin


# --- poses


def path(count=300, rate=100.0):
    times = np.arange(count) / rate
    return times, np.column_stack([np.cos(times), np.sin(times), times + np.pi / 2])


def test_scatter_is_the_noise_of_the_poses():
    times, eta = path(2000)
    noise = np.array([3e-4, 6e-4, 5e-3])
    noisy = eta + np.random.default_rng(1).normal(0, 1, eta.shape) * noise
    assert np.allclose(scatter.third_differences(times, noisy), noise, rtol=0.1)
    assert scatter.third_differences(times[:40], noisy[:40]) is None
    uneven = np.cumsum(np.random.default_rng(1).exponential(0.01, 60))
    assert scatter.third_differences(uneven, noisy[:60]) is None


# --- words on fits


def fit_of(values, deviations, correlation):
    parameters = [
        dict(name=name, value=value, deviation=d, identified=True, at_bound=False)
        for (name, value), d in zip(values.items(), deviations)
    ]
    return {"parameters": parameters, "correlation": correlation}


def test_only_ratio_or_product_of_a_weak_pair_is_known():
    high = [[1, 0.99], [0.99, 1]]
    (weak,) = identifiability.weak_directions(fit_of({"k": 2.0, "m": 4.0}, [0.4, 0.8], high))
    assert weak["known_as"] == "k/m" and weak["parameters"] == ["k", "m"]
    assert weak["deviation"] == pytest.approx(0.2 * np.sqrt(2 * 0.01))
    assert weak["deviations"] == pytest.approx([0.2, 0.2])
    assert weak["strength"] == pytest.approx(1 / np.sqrt(0.02))
    low = [[1, -0.99], [-0.99, 1]]
    (weak,) = identifiability.weak_directions(fit_of({"k": 2.0, "m": 4.0}, [0.4, 0.8], low))
    assert weak["known_as"] == "k*m"
    draws = np.random.default_rng(1).multivariate_normal([2, 4], [[1e-4, -1.98e-4], [-1.98e-4, 4e-4]], 20000)
    product = draws.prod(axis=1)  # of a fortieth of the doubt: there, logarithms are linear
    assert product.std() / product.mean() == pytest.approx(weak["deviation"] / 40, rel=0.05)
    # A negative value turns the sense of the correlation round.
    (weak,) = identifiability.weak_directions(fit_of({"k": -2.0, "m": 4.0}, [0.4, 0.8], low))
    assert weak["known_as"] == "k/m"
    assert not identifiability.weak_directions(fit_of({"k": 2, "m": 4}, [0.4, 0.8], np.eye(2)))
    assert not identifiability.weak_directions(fit_of({"k": 2, "m": 4}, [0.02, 0.04], high))


def test_the_weakest_pair_comes_first_and_bounds_are_named():
    correlation = np.eye(4)
    correlation[0, 1] = correlation[1, 0] = 0.95
    correlation[2, 3] = correlation[3, 2] = 0.999
    fit = fit_of({"a": 1, "b": 1, "c": 1, "d": 1}, [0.3, 0.3, 0.3, 0.3], correlation)
    pairs = [weak["parameters"] for weak in identifiability.weak_directions(fit)]
    assert pairs == [["c", "d"], ["a", "b"]]
    fit["parameters"][1]["at_bound"] = True
    first, *others = identifiability.sentences(fit)
    assert first.startswith("b is at its bound") and len(others) == 2
    assert "±30%" in others[0] and "c/d" in others[0]
    fit["parameters"][2]["identified"] = False
    assert len(list(identifiability.sentences(fit))) == 2
