"""Statistics behind the analysis, against plain references and scipy.stats."""

import numpy as np
import pytest
from scipy import stats

from conftest import MODEL, simulate_run
from ground import _core
from ground.analysis import evidence, folds, window_error
from ground.recordings import repair


def model():
    return _core.load_model(str(MODEL))


def run_data(duration=6.0, seed=1, noise=1.0):
    times, eta, inputs = simulate_run(duration=duration, seed=seed, noise=noise)
    eta[:, 2] = np.unwrap(eta[:, 2])
    level = np.array([3e-4, 3e-4, 5e-3])
    nu = repair.smooth(times, eta, (level[0], level[2]), _core.RunScales())["nu"]
    return _core.RunData("run%d" % seed, times, eta, nu, inputs, eta, level)


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


# --- held-out data


def judged(*parts, errors=()):
    """Made-up errors of windows and log-likelihoods of blocks, in parts that were held out."""
    errors = errors or [np.zeros(len(part)) for part in parts]
    part_of = np.repeat(np.arange(len(errors)), [len(part) for part in errors])
    blocks = tuple(np.array(part, float) for part in parts)
    return folds.Tested(np.concatenate(errors), part_of, blocks)


def part_of_run(mean, count=8, seed=1, scale=1.0):
    """Made-up differences in the blocks or windows of a run."""
    scattered = scale * np.random.default_rng(seed).normal(size=count)
    return mean + scattered - scattered.mean()


@pytest.mark.parametrize(
    "means, verdict",
    [
        ((3.0, 3.0), "better"),
        ((0.05, -0.05), "undecided"),
        ((4.0, -3.0), "undecided"),  # one of two runs got worse
        ((-4.0, 3.0), "undecided"),
        ((-3.0, -4.0), "worse"),
        ((-3.0, -4.0, -2.0, -3.0), "worse"),
        ((-3.0, 2.0, -4.0, 3.0), "undecided"),
        ((-3.0,), "worse"),
        ((-0.1,), "undecided"),
    ],
)  # fmt: skip
def test_held_out_data_refute_what_makes_them_significantly_worse(means, verdict):
    rises = [part_of_run(mean, seed=i) for i, mean in enumerate(means)]
    zeros = [np.zeros(8)] * len(means)
    likelier = folds.compared(judged(*rises), judged(*zeros))
    assert likelier.verdict == verdict
    if verdict != "better":
        errors = [0.01 * -rise for rise in rises]
        gained = [part_of_run(0.0, seed=9, scale=1e-3)] * len(means)
        closer = folds.compared(judged(*gained, errors=errors), judged(*zeros))
        assert (closer.verdict == "worse") == (verdict == "worse")


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
