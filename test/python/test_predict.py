"""What a model predicts of a run, sample by sample."""

import numpy as np
import pytest

import ground
from conftest import MODEL

TURNING = 2e-5  # yaw moment that the given model does not have [N m]


@pytest.fixture(scope="module")
def craft():
    return ground.Model.load(MODEL)


@pytest.fixture(scope="module")
def run(craft):
    return ground.simulate(craft.with_effect("yaw_bias", n0=TURNING), "prbs", duration=15, seed=3)


def test_a_right_model_predicts_to_the_noise_and_a_wrong_one_does_not(craft, run):
    wrong = craft.predict(run)
    right = craft.with_effect("yaw_bias", n0=TURNING).predict(run)
    assert right.heading_deg < 4 * right.noise_deg < wrong.heading_deg
    assert right.position_mm < wrong.position_mm
    assert wrong.horizon == 1.5 and wrong.starts > 10


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
    with pytest.raises(ground.GroundError, match="one run, not 2"):
        ground.predict(craft, [run, ground.simulate(craft, seed=9)])
