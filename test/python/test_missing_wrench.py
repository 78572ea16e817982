"""The missing wrench along a run, and residuals."""

import numpy as np
import pytest

from conftest import MODEL, run_data, simulate_run
from ground import _core
from ground.analysis import missing_wrench, residuals
from ground.recordings import repair


def model():
    return _core.load_model(str(MODEL))


def pushed(force):
    """The model with a constant force X, Y [N]."""
    truth = model()
    truth.add_effect("body_force_bias")
    for name, value in zip(("x0", "y0"), force):
        truth.set_value("body_force_bias." + name, value)
    return truth


# --- the missing wrench


@pytest.mark.parametrize("force", [(0.006, 0.0), (-0.004, 0.003)])
def test_a_constant_force_is_inferred_everywhere(force):
    run = run_data(truth=pushed(force))
    calm = missing_wrench.undisturbed(model(), run)
    assert calm.events == [] and calm.run is run
    missing = missing_wrench.of_wrench(calm, model())
    channels = missing.numbers["channels"]
    for channel, true in zip("XY", force):
        one = channels[channel]
        assert one["mean"] == pytest.approx(true, abs=4e-4)
        assert one["rms"] ** 2 == pytest.approx(one["mean"] ** 2 + one["std"] ** 2)
        assert one["sigma"] == pytest.approx(np.median(missing.sigma[:, "XYN".index(channel)]))
        assert one["unit"] == "N"
    assert channels["N"]["unit"] == "N m" and missing.numbers["disturbances"] == []
    assert np.allclose(missing.heading, np.array(run.eta)[:, 2])
    assert np.allclose(missing.position, np.array(run.eta)[:, :2])
    assert (missing.sigma > 0).all() and missing.wrench.shape == (len(run.times), 3)
    places, forces = missing.by_place()
    assert len(places) == len(forces) > 3
    assert np.hypot(*forces.T).max() < 1.2 * np.hypot(*force)
    full = 2 * model().value("k") * model().input_max
    assert [channels[c]["full_scale"] for c in "XYN"] == pytest.approx(
        [full, full, full * model().value("l")]
    )


def test_a_push_is_left_out_with_some_time_around_it():
    times, eta, inputs = simulate_run(duration=8.0)
    eta[:, 2] = np.unwrap(eta[:, 2])
    struck = times > 4.0
    eta[struck, :2] += (times[struck] - 4.0)[:, None] * [1.2, -0.8]
    smoothed = repair.smooth(times, eta, (3e-4, 5e-3), _core.RunScales())
    noise = np.array([3e-4, 3e-4, 5e-3])
    run = _core.RunData("run", times, smoothed["eta"], smoothed["nu"], inputs, eta, noise)
    calm = missing_wrench.undisturbed(model(), run)
    ((start, end),) = calm.events
    assert 3.4 < start < 3.75 and 4.25 < end < 4.6  # 0.3 s on both sides
    told = missing_wrench.of_wrench(calm, model()).numbers["disturbances"]
    assert told == [{"start": start, "end": end}]
    rest = np.array(calm.run.times)
    assert not ((rest >= start) & (rest <= end)).any() and len(rest) + 100 * (end - start) < 803
    assert np.allclose(np.array(calm.run.poses)[-1], eta[-1])


# --- residuals


def analysed(run):
    return residuals.analyse(run, model(), *residuals.disturbance(run, model(), "white"))


def test_innovations_of_a_true_model_are_white_and_independent_of_the_inputs():
    run = run_data()
    found = analysed(run)
    assert found["white"] and set(found["channels"]) == {"ahead", "starboard", "heading"}
    for channel in found["channels"].values():
        assert channel["input_sum"]["accepted"] and channel["input_difference"]["accepted"]
        lags = channel["autocorrelation"]
        assert lags["lag_seconds"] == pytest.approx([0.01 * k for k in lags["lag_samples"]])
    assert found["noise"]["position"]["value"] == pytest.approx(3e-4, rel=0.3)
    assert found["samples"] <= len(run.times)


def test_residuals_of_a_model_without_the_lag_of_the_motors_follow_the_inputs():
    truth = model()
    truth.add_effect("motor_lag")
    truth.set_value("motor_lag.tau", 0.08)
    found = analysed(run_data(truth=truth))
    ahead = found["channels"]["ahead"]["input_sum"]
    assert not ahead["accepted"] and ahead["outside"] > 3
