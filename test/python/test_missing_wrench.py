"""The missing wrench along a run, and residuals."""

import numpy as np
import pytest

from conftest import MODEL, run_data
from ground import _core
from ground.analysis import missing_wrench


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
    channels = missing.numbers.channels
    for channel, true in zip("XY", force):
        one = channels[channel]
        assert one.mean == pytest.approx(true, abs=4e-4)
        assert one.rms**2 == pytest.approx(one.mean**2 + one.std**2)
        assert one.sigma == pytest.approx(np.median(missing.sigma[:, "XYN".index(channel)]))
        assert one.unit == "N"
    assert channels["N"].unit == "N m" and missing.numbers.disturbances == []
    assert np.allclose(missing.heading, np.array(run.eta)[:, 2])
    assert np.allclose(missing.position, np.array(run.eta)[:, :2])
    assert (missing.sigma > 0).all() and missing.wrench.shape == (len(run.times), 3)
    places, forces = missing.by_place()
    assert len(places) == len(forces) > 3
    assert np.hypot(*forces.T).max() < 1.2 * np.hypot(*force)
    full = 2 * model().value("k") * model().input_max
    assert [channels[c].full_scale for c in "XYN"] == pytest.approx([full, full, full * model().value("l")])


# --- residuals
