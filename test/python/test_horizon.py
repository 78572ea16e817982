"""Predicted poses at the horizon that suits a craft."""

import functools

import numpy as np
import pytest

from conftest import MODEL
from ground import _core
from ground.analysis import horizon
from ground.poses import repair

FREE_FLYER = """
schema: ground/model/1
body:
  m: 16
  I_z: 0.18
  X_u: 0.01
  Y_v: 0.01
  N_r: 0.0005
  k: 0.4
  thrusters:
    - {name: ahead, position: [0, 0], direction: 0, range: [-1, 1]}
    - {name: aside, position: [0, 0], direction: 90, range: [-1, 1]}
    - {name: left, position: [0, -0.11], direction: 0, range: [-0.25, 0.25]}
    - {name: right, position: [0, 0.11], direction: 0, range: [-0.25, 0.25]}
"""


def hovercraft():
    return _core.load_model(str(MODEL))


def free_flyer():
    return _core.parse_model(FREE_FLYER, "free_flyer")


@functools.lru_cache(maxsize=None)
def run_of(craft=hovercraft, duration=8.0, force=0.0, noise=(3e-4, 3e-4, 5e-3), rate=100, seed=1):
    """A run in which all thrusters act at random and a constant force pushes ahead."""
    model, random = craft(), np.random.default_rng(seed)
    ranges = [(0.0, 1.0)] * 2 if model.is_pair else [t["range"] for t in model.thrusters]
    count = int(duration * 4)
    levels = np.column_stack([random.uniform(*ends, size=count) for ends in ranges])
    inputs = np.column_stack([np.arange(count) / 4, levels, np.ones(count)])
    times = np.arange(int(duration * rate)) / rate
    wrench = np.tile([force, 0.0, 0.0], (len(times), 1))
    eta = _core.simulate(model, inputs, times, np.zeros(3), np.zeros(3), [0.0], wrench)["eta"]
    poses = eta + random.normal(size=eta.shape) * noise
    found = repair.smooth(times, poses, (noise[0], noise[2]), _core.RunScales())
    return _core.RunData("run", times, found["eta"], found["nu"], inputs, poses, np.array(noise))


def test_the_horizon_suits_the_craft():
    assert horizon.horizon([run_of()], hovercraft()) == 1.0
    assert horizon.horizon([run_of(free_flyer, duration=60.0)], free_flyer()) == 10.0


def test_the_horizon_suits_the_runs():
    short = horizon.horizon([run_of(free_flyer, duration=8.0)], free_flyer())
    assert 1.0 <= short < 10.0 and len(horizon.starts([run_of(free_flyer, duration=8.0)], short)) >= 4
    assert horizon.horizon([run_of(duration=60.0, rate=11, noise=(1e-3, 1e-3, 1e-2))], hovercraft()) >= 0.9


def test_what_the_mocap_leaves_is_what_the_true_model_leaves():
    """On recordings of the true model; the wrong one is off by more, and so are predictions under a push."""
    runs, model, seconds = [run_of(duration=60.0, noise=(3e-4, 3e-4, 5e-3))], hovercraft(), 1.0
    wrong = model.copy()
    wrong.set_value("k", 1.2 * model.value("k"))
    models = {"true": horizon.same(model), "wrong": horizon.same(wrong)}
    found = horizon.prediction_error(runs, seconds, models, model)
    assert found.errors["true"].position_mm == pytest.approx(found.mocap.position_mm, rel=0.4)
    assert found.errors["true"].heading_deg == pytest.approx(found.mocap.heading_deg, rel=0.4)
    assert found.errors["wrong"].position_mm > 5 * found.mocap.position_mm and found.disturbed is None


def test_runs_that_are_too_short_have_no_prediction_error():
    run = run_of(duration=1.0)
    assert horizon.prediction_error([run], 5.0, {"a": horizon.same(hovercraft())}, hovercraft()) is None
