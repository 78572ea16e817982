"""Crafts on water: what a diagnosis tries, and that it finds a hidden current and cross-flow."""

import numpy as np
import pytest

import ground
import ship
from ground import _core
from ground.analysis import candidates
from ground.support import errors

BOAT = """
schema: ground/model/1
name: Catamaran
body:
  m: 15.0
  I_z: 2.0
  X_u: 15.0
  Y_v: 40.0
  N_r: 6.0
  k: 35.0
  thrusters:
    - {name: port, position: [-0.4, -0.285], direction: 0, range: [-1, 1]}
    - {name: starboard, position: [-0.4, 0.285], direction: 0, range: [-1, 1]}
  hull: {length: 1.2}
effects:
  - {name: added_mass, mx: 3.0, my: 12.0}
"""


def boat(**hidden):
    model = ground.Model.parse(BOAT)
    for effect, values in hidden.items():
        model = model.with_effect(effect, **values)
    return model


def recorded(model, seed, seconds=40):
    """A run with random commands; there is no channel of a lift."""
    random = np.random.default_rng(seed)
    at = np.arange(0, seconds, 1.0)
    levels = random.uniform(-0.4, 1, (len(at), 2))
    times = np.arange(0.05, seconds, 0.05)
    rows = np.column_stack([at, levels, np.zeros(len(at))])
    eta = _core.simulate(model.core, rows, times, np.zeros(3), np.zeros(3))["eta"]
    poses = eta + random.normal(size=eta.shape) * (1e-3, 1e-3, 1e-3)
    commands = np.column_stack([levels, np.zeros(len(at))])
    return ground.Recording.from_arrays(
        times, poses, commands, at, channels=("port", "starboard", "lift"), name="run %d" % seed
    )


def test_a_diagnosis_tries_what_suits_a_hull():
    afloat = {c.name for c in candidates.library(boat().core)}
    on_floor = {
        c.name
        for c in candidates.library(ground.Model.parse(BOAT.replace("  hull: {length: 1.2}\n", "")).core)
    }
    assert {"surge_resistance", "hull_lift", "cross_flow_drag", "current"} <= afloat
    assert {"drift_resistance", "hull_nonlinear"} <= afloat
    assert not {"skirt_friction", "momentum_drag", "floor_tilt", "coulomb_friction", "wind"} & afloat
    assert {"skirt_friction", "floor_tilt", "wind"} <= on_floor and "current" not in on_floor


@pytest.mark.parametrize("side", [1, -1])
def test_the_tanker_turns_as_a_model_of_it_does_in_a_tank(side):
    advance, diameter, speed = ship.circle(ship.craft(), side)
    for found, (least, most) in zip((advance, diameter), ship.PUBLISHED.values()):
        assert 0.95 * least < found < 1.05 * most
    assert 0.2 < speed < 0.5


def test_a_current_is_found_with_its_direction():
    truth = boat(current={"wx": 0.15, "wy": -0.1})
    runs = [recorded(truth, seed) for seed in (1, 2)]
    fitted = ground.fit(
        boat(current={"wx": 0.01, "wy": 0.01}),
        runs,
        free=["k", "X_u", "Y_v", "N_r", "I_z", "current.wx", "current.wy"],
    )
    for name, value in (("current.wx", 0.15), ("current.wy", -0.1)):
        low, high = fitted.parameters[name].ci95
        assert low < value < high and high - low < 0.1


def test_a_diagnosis_names_the_hidden_effect_of_the_hull():
    truth = boat(cross_flow_drag={"fore": 60.0, "aft": 90.0})
    runs = [recorded(truth, seed) for seed in (3, 4)]
    told = ground.diagnose(boat(), runs, only=["cross_flow_drag", "current", "surge_resistance"])
    assert told.effects == ("cross_flow_drag",)
    assert told.improved["cross_flow_drag.aft"] == pytest.approx(90, rel=0.3)


def test_propellers_that_push_less_backward_are_named():
    runs = [recorded(boat(reverse_loss={"a": 0.5}), seed) for seed in (1, 2)]
    told = ground.diagnose(boat(), runs, only=["reverse_loss", "thrust_curve", "surge_resistance"])
    assert told.effects == ("reverse_loss",)
    low, high = told.parameters["reverse_loss.a"].ci95
    assert 0.48 < low < 0.5 < high < 0.52


def test_a_boat_without_a_hull_is_told_to_have_one():
    ashore = ground.Model.parse(BOAT.replace("  hull: {length: 1.2}\n", ""))
    with pytest.warns(ground.GroundWarning, match="hull: {length: METRES}"):
        ground.diagnose(ashore, recorded(ashore, 1), only=["surge_resistance"])


def test_a_verb_says_a_warning_once(capsys):
    with errors.warnings_as_lines():
        for text in ("runs differ", "runs differ", "no voltage"):
            errors.warn(text)
    assert capsys.readouterr().err == "warning: runs differ\nwarning: no voltage\n"
