"""Crafts with other actuators than fixed thrusters: one fan and a rudder in its stream, valves, ships."""

import numpy as np
import pytest

import ground
import one_fan
from conftest import MODEL, ROOT, identify
from ground import _core
from ground.analysis import diagnosis
from ground.checks import suspicions
from ground.data.measured import Part, measured
from ground.effect_library import candidates
from ground.support.progress import Work

CRAFTS = ROOT / "cfg" / "craft"
ONE_FAN = CRAFTS / "one_fan_rudder.yaml"
NEW = ["one_fan_rudder", "free_flyer", "twin_screw_catamaran", "propeller_ship"]


@pytest.fixture(scope="module")
def model():
    return _core.load_model(str(ONE_FAN))


def test_the_core_moves_the_craft_as_the_truth_of_the_bench(model):
    edges = np.arange(0, 5, one_fan.HOLD)
    random = np.random.default_rng(1)
    commands = np.column_stack([random.uniform(0, 1, len(edges)), random.uniform(-1, 1, len(edges))])
    truth = one_fan.OneFan(model, offset=0.1, dead_band=0.1).poses(commands, [0.0, 0.0, 0.4])
    wrong = model.copy()
    wrong.add_effect("angle_offset_rudder")
    wrong.set_value("angle_offset_rudder.angle", 0.1)
    wrong.add_effect("dead_band_rudder")
    wrong.set_value("dead_band_rudder.width", 0.1)
    inputs = np.column_stack([edges, commands, np.ones(len(edges))])
    times = np.arange(len(truth)) / one_fan.RATE
    eta = _core.simulate(wrong, inputs, times, [0.0, 0.0, 0.4], np.zeros(3))["eta"]
    assert np.abs(eta - truth).max() < 1e-5
    plain = _core.simulate(model, inputs, times, [0.0, 0.0, 0.4], np.zeros(3))["eta"]
    assert np.abs(plain - truth).max() > 0.1


def test_a_fit_recovers_the_craft(model):
    """A user has recordings, and a model file whose values are guessed."""
    truth = ground.Model.load(ONE_FAN).with_effect("foil_gain_rudder", a=0.4)
    run = ground.simulate(truth, "multilevel-prbs", seed=3, duration=30)
    start = truth.core.copy()
    for name, factor in (("k", 0.7), ("I_z", 1.5), ("N_r", 0.5), ("Y_v", 2.0)):
        start.set_value(name, factor * start.value(name))
    start.set_value("foil_gain_rudder.a", 0.0)
    free = ["k", "I_z", "N_r", "Y_v", "X_u", "foil_gain_rudder.a"]
    found = ground.fit(ground.Model(start), [run], free=free).parameters
    for name in ("k", "I_z", "N_r", "Y_v"):
        assert found[name].value == pytest.approx(truth.core.value(name), rel=0.05), name
    assert found["foil_gain_rudder.a"].value == pytest.approx(0.4, abs=0.07)


def test_a_diagnosis_names_the_offset_of_a_rudder(model):
    craft = one_fan.OneFan(model, offset=np.radians(4))
    runs = one_fan.runs_of(craft, np.random.default_rng(7), count=3, duration=12.0)
    found = diagnosis.StepwiseDiagnosis(runs, model, candidates.library(model))
    found.grow()
    assert list(found.names) == ["angle_offset_rudder"]
    values = {p["name"]: p["value"] for p in found.fit.parameters}
    assert values["angle_offset_rudder.angle"] == pytest.approx(np.radians(4), abs=0.01)


MEMORY = {
    "motor_rise_fall": {"rise": 0.08, "fall": 0.025},
    "motor_rate": {"rate": 5.0},
    "supply_sag": {"part": 0.25, "time": 0.6},
    "thrust_droop": {"part": 0.25, "time": 0.6},
    "motor_lag": {"tau": 0.05},
}


@pytest.mark.parametrize("effect", MEMORY)
def test_a_diagnosis_names_the_memory_of_thrusters(effect):
    given = ground.Model.load(MODEL)
    truth = given.with_effect(effect, **MEMORY[effect])
    runs = [ground.simulate(truth, "multilevel-prbs", seed=seed, duration=10) for seed in (1, 2, 3)]
    found = ground.diagnose(given, runs, only=[*MEMORY, "input_delay", "battery_sag"])
    assert found.effects == (effect,)
    for name, value in MEMORY[effect].items():
        low, high = found.report["improved"]["parameters"]["%s.%s" % (effect, name)]["ci95"]
        assert low < value < high, name


def test_one_lag_is_named_although_two_were_added_beside_it():
    """Commands that a busy computer sends late make two lags a little likelier."""
    given = ground.Model.load(MODEL)
    run = ground.simulate(given.with_effect("motor_lag", tau=0.05), "multilevel-prbs", seed=1, duration=10)
    lags = [c for c in candidates.library(given.core) if c.name in ("motor_lag", "motor_rise_fall")]
    runs = measured([run], given, Part(), Work()).data
    found = diagnosis.StepwiseDiagnosis(runs, given.core, lags)
    both = frozenset()
    for name in ("motor_lag", "motor_rise_fall"):
        both = found.search.beside(both, name)
    assert found._simplest(both) == {"motor_lag"}


def test_nothing_is_suspected_of_channels_that_are_angles(model):
    run = ground.simulate(ground.Model.load(ONE_FAN), "multilevel-prbs", seed=4, duration=20)
    assert suspicions.about([run], model) == []


@pytest.mark.parametrize("name", NEW)
def test_each_craft_is_a_model_that_runs(name):
    craft = ground.Model.load(CRAFTS / (name + ".yaml"))
    assert _core.parse_model(craft.core.format(), "again.yaml").format() == craft.core.format()
    run = ground.simulate(craft, "multilevel-prbs", seed=2, duration=8)
    assert np.isfinite(run.eta).all()


def test_valves_have_times_and_a_supply(tmp_path):
    craft = ground.Model.load(CRAFTS / "free_flyer.yaml")
    assert {"valve_lag", "supply_droop"} <= set(_core.effects(craft.core))
    assert "angle_offset_valve_1" not in _core.effects(craft.core)
    assert not {"valve_lag", "supply_droop"} & set(_core.effects())


def test_a_wrong_file_is_refused_by_key_line_and_range(tmp_path):
    text = ONE_FAN.read_text()
    for old, new, what in (
        ("stream: fan", "stream: fin", "in the stream of fin"),
        ("angle: 30", "angle: 1000", "angle must be between -360 and 360 degrees, not 1000"),
        ("jet: 212", "jett: 212", "jett"),
        ("own_sway: 1", "own_sway: 7", "own_sway must be between 0 and 3"),
    ):
        assert old in text
        path = tmp_path / "craft.yaml"
        path.write_text(text.replace(old, new, 1))
        result = identify("simulate", "--model", path, "--input", "prbs", "-o", tmp_path / "run.bag")
        assert result.returncode != 0 and what in result.stderr and "line" in result.stderr
        assert "Traceback" not in result.stderr


def test_the_thrust_of_a_thruster_that_turns_acts_along_its_angle(tmp_path):
    from types import SimpleNamespace

    from ground.analysis import channels, dictionary

    path = tmp_path / "ferry.yaml"
    path.write_text(
        """
schema: ground/model/1
name: a ferry
body:
  {m: 10, I_z: 2, X_u: 1, Y_v: 2, N_r: 1, k: 5, hull: {length: 1},
   thrusters: [{name: bow, position: [0.4, 0], direction: 0}, {name: turn, turns: bow, angle: 180}]}
effects: []
"""
    )
    model = ground.Model.load(path).core
    assert [list(one.parts) for one in channels.thrusts(model)] == [["thrust_bow"], ["thrust_bow"]]
    angle = np.array([0.0, 0.5, -0.5])  # 0, 90 and -90 deg
    sampled = SimpleNamespace(values={"u_bow": np.ones(3), "u_turn": angle}, times=np.arange(3.0))
    found = dictionary._directions(model, sampled)["thrust_bow"]
    assert found == pytest.approx(np.array([[1, 0, 0], [0, 1, 0.4], [0, -1, -0.4]]), abs=1e-9)


def exact(times, command, rate):
    """Mean of w between times, dw/dt = rate(u, w), by steps of 20 us; command: (time, u) changes."""
    step, w, means = 2e-5, 0.0, []
    for begin, end in zip(times[:-1], times[1:]):
        grid = begin + step * (0.5 + np.arange(round((end - begin) / step)))
        seen = []
        for now in grid:
            u = [value for at, value in command if at <= now]
            w = rate(u[-1] if u else 0.0, w, step)
            seen.append(w)
        means.append(np.mean(seen))
    return np.array(means)


@pytest.mark.parametrize(
    "effect, parameters, rate",
    [
        ("motor_lag", {"tau": 0.08}, lambda u, w, h: w + h * (u - w) / 0.08),
        ("motor_rise_fall", {"rise": 0.1, "fall": 0.03},
         lambda u, w, h: w + h * (u - w) / (0.1 if u > w else 0.03)),
        ("motor_rate", {"rate": 4.0}, lambda u, w, h: w + np.clip(u - w, -4.0 * h, 4.0 * h)),
    ],
)  # fmt: skip
def test_what_reaches_the_thrusters_is_what_the_actuators_make_of_commands(effect, parameters, rate):
    """Formulas of what is left depend on it, whichever actuators the model has."""
    model = _core.load_model(str(MODEL))
    model.add_effect(effect)
    model.add_effect("input_delay")
    model.set_value("input_delay.delay", 0.03)
    for name, value in parameters.items():
        model.set_value("%s.%s" % (effect, name), value)
    rows = np.array([[0.0, 0, 0, 1], [0.1, 0.8, 0, 1], [0.33, 0.2, 0, 1], [0.5, 1.0, 0, 0]])
    times = np.arange(0, 0.9, 0.02)
    found = _core.mean_inputs(model, rows, times)
    wanted = exact(times, [(at + 0.03, left) for at, left in rows[:, :2]], rate)
    assert np.abs(found[:, 0] - wanted).max() < 2e-3 and np.abs(found[:, 1]).max() == 0
    assert found[-1, -1] == 0 and found[5, -1] == 1
    later = _core.mean_inputs(model, rows, times[20:])  # earlier commands have settled the actuators
    assert np.abs(later - found[20:]).max() < 1e-3


@pytest.mark.parametrize("effect", ["supply_sag", "thrust_droop"])
@pytest.mark.parametrize("craft", ["hovercraft/tiny_whoover", "hovercraft/mvwt"])
def test_a_load_is_relative_to_full_input(effect, craft):
    """Full input loses the part, whatever the number of full input."""
    model = _core.load_model(str(ROOT / "cfg" / (craft + ".yaml")))
    model.add_effect(effect)
    model.set_value(effect + ".part", 0.3)
    model.set_value(effect + ".time", 0.5)
    full = model.input_max
    found = _core.mean_inputs(model, np.array([[0.0, full, full, 1.0]]), np.array([0.0, 0.01, 6.0, 6.1]))
    assert found[0, 0] == pytest.approx(full, rel=0.02)
    assert found[-1, :2] == pytest.approx([0.7 * full] * 2, rel=1e-3)
