"""Effects with states, from the model file to the fit of their parameters."""

import numpy as np
import pytest

from conftest import MODEL

SKIRT = """
effects:
  - name: skirt
    states: {p: "(lift - p)/tau"}
    expression: {X: "-c*(1 - p)*u", Y: "-c*(1 - p)*v"}
    parameters:
      c: {value: 0.02, unit: N s/m, lower: 0, scale: 0.01}
      tau: {value: 0.8, unit: s, neutral: 0.4, lower: 0.01, scale: 0.2}
"""
DROOP = """
effects:
  - name: droop
    states:
      w: {derivative: "((u_L + u_R)/2 - w)/tau", initial: 0.1}
    expression: {thrust_L: "-c*w*u_L", thrust_R: "-c*w*u_R"}
    parameters:
      c: {value: 0.015, unit: N, scale: 0.01}
      tau: {value: 0.7, unit: s, neutral: 0.4, lower: 0.01, scale: 0.2}
"""


def planted(effects):
    """The craft's model with effects, given as YAML."""
    from ground import _core

    return _core.parse_model(MODEL.read_text().replace("\neffects: []\n", effects), "planted")


def noise_free(model):
    """RunData of two runs of 8 s with changing lift, without noise."""
    from ground import _core

    runs = []
    for seed in (1, 2):
        edges = np.arange(0, 8, 1 / 15)
        bits = np.resize(np.array(_core.make_prbs(9, 97 * seed), float), (len(edges), 2))
        lift = np.where(edges % 2 < 1.2, 1.0, 0.6)
        inputs = np.column_stack([edges, bits, lift])
        times = np.arange(0, 8, 0.01)
        found = _core.simulate(model, inputs, times, np.zeros(3), np.zeros(3))
        runs.append(_core.RunData("run", times, found["eta"], found["nu"], inputs))
    return runs


@pytest.mark.parametrize("name, text", [("skirt", SKIRT), ("droop", DROOP)])
def test_the_parameters_of_a_planted_effect_are_found_from_its_neutral_values(name, text):
    from ground.analysis import windows
    from ground.effect_library import candidates

    truth = planted(text)
    runs = noise_free(truth)
    without = truth.copy()
    without.remove_effect(name)
    off = np.array(noise_free(without)[0].nu) - np.array(runs[0].nu)
    assert np.abs(off).max() > 0.02, "the effect changes the motion"
    start = truth.copy()
    free = [p.name for p in candidates.parameters_of(truth, name)]
    start.set_value(name + ".c", 0.005)
    start.set_value(name + ".tau", 0.4)
    found = windows.problem(runs, windows.cut(runs)).fit(start, free)
    for parameter in free:
        value = found["model"].value(parameter)
        assert value == pytest.approx(truth.value(parameter), rel=1e-4), parameter


SWINGING = """
effects:
  - name: load
    states: {px: qx, qx: "w^2*(x - px) - qx", py: qy, qy: "w^2*(y - py) - qy"}
    expression:
      X: "c*((px - x)*cos(psi) + (py - y)*sin(psi))"
      Y: "c*((py - y)*cos(psi) - (px - x)*sin(psi))"
    parameters:
      c: {value: 0.3, unit: N/m, scale: 0.1}
      w: {value: 6, unit: rad/s, neutral: 6, lower: 1, scale: 1}
"""


def test_a_window_of_a_motion_begins_with_what_the_motion_before_it_has_left():
    from ground import _core
    from ground.analysis import windows

    truth = planted(SWINGING)
    runs = noise_free(truth)
    cut = [w for w in windows.cut(runs) if w.run == 0 and runs[0].times[w.first] > 2]
    nu = np.array(runs[0].nu)
    predicted = _core.predict(truth, runs[0], cut, nu[[w.first for w in cut]])["nu"]
    simulated = windows.problem(runs, cut).simulate(truth)["nu"]
    for w, *motions in zip(cut, predicted, simulated):
        for motion in motions:
            error = np.abs(motion - nu[w.first : w.last + 1]).max(axis=0)
            assert (error < 0.002 * nu.std(axis=0)).all()


def test_a_saved_model_with_states_is_the_same_when_loaded(tmp_path):
    from ground import _core

    model = planted(DROOP)
    path = tmp_path / "droop.yaml"
    path.write_text(model.format())
    again = _core.load_model(str(path))
    assert again.format() == model.format()
    for a, b in zip(noise_free(again), noise_free(model)):
        assert np.array_equal(a.nu, b.nu)
