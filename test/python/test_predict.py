"""What a model predicts of a run, sample by sample."""

import numpy as np
import pytest

import ground

TURNING = 2e-5  # yaw moment that the given model does not have [N m]


@pytest.fixture(scope="module")
def run(craft):
    return ground.simulate(craft.with_effect("yaw_bias", n0=TURNING), "prbs", duration=15, seed=3)


def test_a_right_model_predicts_to_the_noise_and_a_wrong_one_does_not(craft, run):
    wrong = craft.predict(run)
    right = craft.with_effect("yaw_bias", n0=TURNING).predict(run)
    assert right.heading_deg < 4 * right.noise_deg < wrong.heading_deg
    assert right.position_mm < wrong.position_mm
    assert wrong.horizon == ground.Predictor(craft, run).horizon and wrong.starts > 10


def test_errors_grow_with_the_horizon(craft, run):
    errors = [craft.predict(run, horizon=seconds).heading_deg for seconds in (0.3, 1.0, 3.0)]
    assert errors == sorted(errors)


def test_arrays_belong_together(craft, run):
    made = ground.predict(craft, run, horizon=1.0)
    assert made.measured.shape == made.predicted.shape == made.residuals.shape == (len(made.times), 6)
    assert (np.diff(made.times) > 0).all()
    assert 0 < made.ahead.min() and made.ahead.max() < 1.01
    assert np.abs(made.residuals[:, 2]).max() <= np.pi
    late = made.ahead > 0.9
    early = made.ahead < 0.1
    off = np.hypot(*made.residuals[:, :2].T)
    assert off[late].mean() > off[early].mean()
    assert sum(len(piece["times"]) for piece in made.pieces) == len(made.times)
    frame = made.to_frame()
    assert np.allclose(frame.y, frame.y_predicted + frame.y_residual)
    assert frame.attrs["units"]["ahead"] == "s"


def test_a_run_of_a_controller_is_predicted(craft):
    flown = ground.simulate(craft, "tracking", duration=15, reference="circle", seed=2)
    made = craft.predict(flown)
    assert made.position_mm < 20 and made.heading_deg < 5


def test_only_a_part_is_predicted_if_asked(craft, run):
    made = ground.predict(craft, run, start=3.0, end=8.0)
    assert 3.0 <= made.times.min() and made.times.max() <= 8.0


@pytest.mark.parametrize(
    "horizon,words", [(60.0, "no run is long enough"), (0.0, "positive"), (float("nan"), "positive")]
)
def test_an_impossible_horizon_is_refused(craft, run, horizon, words):
    with pytest.raises(ground.GroundError, match=words):
        craft.predict(run, horizon=horizon)


def test_several_runs_are_refused(craft, run):
    with pytest.raises(ground.GroundError, match="not 2"):
        ground.predict(craft, [run, ground.simulate(craft, seed=9)])


def test_a_whole_run_is_predicted_from_its_beginning(craft, run):
    made = craft.with_effect("yaw_bias", n0=TURNING).predict(run, horizon=np.inf)
    assert made.starts == 1 and made.pieces[0]["times"][0] == made.times[0]
    assert made.horizon == pytest.approx(made.ahead.max()) and made.horizon > 10
    assert made.heading_deg < craft.predict(run, horizon=np.inf).heading_deg


@pytest.fixture(scope="module")
def fitted(craft):
    """A craft that turns by itself and has a drag that grows with speed, fitted without both."""
    truth = craft.with_effect("quadratic_drag", cx=0.08, cy=0.08).with_effect("yaw_bias", n0=3e-6)
    runs = [ground.simulate(truth, "prbs", duration=12, seed=seed) for seed in range(1, 6)]
    others = [ground.simulate(truth, "multilevel-prbs", duration=12, seed=seed) for seed in (20, 21, 22)]
    return ground.fit(craft, runs), others


@pytest.mark.parametrize("horizon", [1.0, np.inf])
def test_a_band_holds_its_share_of_runs_that_were_not_fitted_to(fitted, horizon):
    fit, others = fitted
    made = [fit.predict(run, horizon=horizon, band=0.8) for run in others]
    assert np.mean([one.held[:3] for one in made]) > 0.75
    wide = fit.predict(others[0], horizon=horizon, band=0.95)
    assert (wide.high - wide.low >= made[0].high - made[0].low).all()
    assert "x_low" in made[0].to_frame() and "Band of 80%" in str(made[0].summary())
    drawn = [trace for trace in made[0].plot("motion").data if trace.name == "80% band"]
    assert len(drawn) == 4  # u, v, r and the path
    path = np.array(drawn[-1].y, float)  # x of the room
    assert np.nanmin(path) < made[0].predicted[:, 0].min() < made[0].predicted[:, 0].max() < np.nanmax(path)
    if np.isinf(horizon):  # errors grow, and so does the band
        half = (made[0].high - made[0].low)[:, 0]
        assert half[-1] > 3 * half[0]


def test_a_band_says_where_the_model_goes_beyond_what_it_was_fitted_to(craft):
    slow = [ground.simulate(craft, "prbs", duration=8, seed=seed, levels=(0, 0.2)) for seed in (1, 2, 3)]
    fast = ground.simulate(craft, "prbs", duration=8, seed=4)
    with pytest.warns(ground.GroundWarning, match="beyond the runs"):
        ground.fit(craft, slow).predict(fast, band=0.9)


def test_a_band_needs_runs_that_are_held_out(craft, run, fitted):
    with pytest.raises(ground.GroundError, match="two runs or more"):
        ground.fit(craft, run).predict(run, band=0.9)
    with pytest.raises(ground.GroundError, match="between 0 and 1"):
        fitted[0].predict(fitted[1][0], band=90)
