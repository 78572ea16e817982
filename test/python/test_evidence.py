"""The statistics of the diagnosis: honest when nothing is hidden, sharp when something is."""
import numpy as np
import pytest
from conftest import MODEL, simulate_run
from scipy import stats


@pytest.fixture(scope="module")
def gains():
    """Log-likelihood ratios of floor_tilt in runs without one, and what score tests expect."""
    from ground import _core
    from ground.analysis import candidates, evidence, study
    from ground.recordings import repair, windows

    model = _core.load_model(str(MODEL))
    free = study.free_parameters(model)
    found = []
    for seed in range(40):
        times, eta, inputs = simulate_run(seed=seed + 1, nu=(0.3, 0.1, 1))
        eta[:, 2] = np.unwrap(eta[:, 2])
        noise = (3e-4, 3e-4, 5e-3)
        smoothed = repair.smooth(times, eta, (noise[0], noise[2]))
        run = _core.RunData("run", times, smoothed["eta"], smoothed["nu"], inputs, eta, noise)
        under, fitted = evidence.Evidence([run], windows.cut([run])).settle(model, free)
        extended = candidates.of_library("floor_tilt").neutral(fitted["model"])
        names = ["floor_tilt.sx", "floor_tilt.sy"]
        tested = under.scores(extended, free + names).test(names, free)
        refitted = under.fit(extended, free + names)
        gain = 2 * (fitted["costs"].sum() - refitted["costs"].sum())
        found.append((gain, tested["gain"], tested["inflation"], under.disturbed))
    return np.array(found)


def test_gains_of_what_is_not_there_are_chance(gains):
    # 95% of 40 draws of a chi squared of two lie below 6; the robust loss takes a little.
    assert stats.kstest(gains[:, 0], stats.chi2(2).cdf).pvalue > 0.01
    assert 1.2 < gains[:, 0].mean() < 2.9


def test_a_score_test_foretells_the_gain_of_a_refit(gains):
    assert np.abs(gains[:, 0] - gains[:, 1]).max() < 0.5


def test_a_true_model_needs_no_disturbance(gains):
    assert (gains[:, 3] < 15).mean() > 0.95


def test_p_values_know_bounds_and_blocks():
    from ground.analysis import evidence

    assert evidence.p_value(0.0, 1.0, 50, 1, 1) == 1.0
    two_sided = evidence.p_value(4.0, 1.0, 10**6, 1, 0)
    assert two_sided == pytest.approx(stats.chi2.sf(4, 1), rel=1e-3)
    assert evidence.p_value(4.0, 1.0, 10**6, 1, 1) == pytest.approx(two_sided / 2, rel=1e-3)
    assert evidence.p_value(4.0, 1.0, 12, 1, 0) > 1.5 * two_sided  # few blocks say little
    assert evidence.p_value(8.0, 2.0, 10**6, 1, 0) == pytest.approx(two_sided, rel=1e-3)
    mixed = evidence.p_value(4.0, 1.0, 10**6, 2, 1)
    assert mixed == pytest.approx((stats.chi2.sf(4, 1) + stats.chi2.sf(4, 2)) / 2, rel=1e-3)


def test_a_refit_cannot_lose_what_the_neutral_effect_has(gains):
    assert gains[:, 0].min() > -0.02
