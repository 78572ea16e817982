"""Effects as objects: of the library, formulas, files and Python functions."""

import pickle

import numpy as np
import pytest

import ground
from conftest import ROOT

FORMULA = dict(X="a*sin(2*pi*x/0.3)", a=(0.01, "N"), frame="world")
FILE = """name: washboard
frame: world
expression: {X: "a*sin(2*pi*x/0.3)"}
parameters:
  a: {value: 0.01, unit: N, lower: -1, upper: 1}
"""


def waves(state, inputs, a):
    return a * np.sin(2 * np.pi * state.x / 0.3), 0, 0


def of_file(folder):
    (folder / "washboard.yaml").write_text(FILE)
    return ground.Effect.load(folder / "washboard.yaml")


def flown(model):
    return ground.simulate(model, "prbs", duration=8, seed=2)


def test_one_effect_is_the_same_however_it_is_written(craft, tmp_path):
    written = [
        ground.Effect("washboard", **FORMULA),
        ground.Effect("washboard", force=waves, a=(0.01, "N"), frame="world"),
        of_file(tmp_path),
        ground.Effect.of(
            {
                "name": "washboard",
                "frame": "world",
                "expression": {"X": "a*sin(2*pi*x/0.3)"},
                "parameters": {"a": {"value": 0.01, "unit": "N"}},
            }
        ),
    ]
    runs = [flown(craft + effect) for effect in written]
    assert all(np.allclose(run.eta, runs[0].eta, atol=1e-9) for run in runs[1:])
    assert np.abs(runs[0].eta - flown(craft).eta).max() > 0.01
    for effect in written:
        assert effect.parameters["a"].unit == "N" and effect.parameters["a"].value == 0.01
        assert pickle.loads(pickle.dumps(effect)) == effect


def test_models_with_effects_are_sums_and_equal_by_content(craft, tmp_path):
    effect = ground.Effect("washboard", **FORMULA)
    larger = craft + effect + "wind"
    assert larger.effects == ("washboard", "wind")
    assert larger - "wind" == craft + effect and larger - "wind" - effect == craft
    assert hash(larger - "wind") == hash(craft + effect)
    assert craft + effect != craft and craft.with_values({"k": 0.07}) != craft
    assert (craft + ground.Effect("wind", wx=0.2))["wind.wx"] == 0.2
    saved = larger.save(tmp_path / "larger.yaml")
    assert saved == larger == pickle.loads(pickle.dumps(larger)) and len({saved, larger}) == 1
    effect.save(tmp_path / "effect.yaml")
    assert craft + ground.Effect.load(tmp_path / "effect.yaml") == craft + effect


def test_every_verb_takes_an_effect(craft):
    effect = ground.Effect("washboard", force=waves, a=(0.01, "N"), frame="world")
    run = flown(craft + effect)
    found = ground.fit((craft + effect).with_values({"washboard.a": 0.004}), run, free=["washboard.a"])
    low, high = found.parameters["washboard.a"].ci95
    assert low < 0.01 < high
    assert ground.add(craft, effect, run).verdict.helps
    diagnosis = ground.diagnose(craft, run, only=["yaw_bias", "washboard"], effects=[effect])
    assert diagnosis.effects == ("washboard",)
    assert diagnosis.improved["washboard.a"] == pytest.approx(0.01, rel=0.1)
    assert (craft + effect).predict(run).position_mm < 0.2 * craft.predict(run).position_mm


class Given:
    """Numbers in place of symbols."""

    def __init__(self, **names):
        vars(self).update(names)


def test_what_a_function_does_is_what_its_formula_does():
    def force(state, inputs, a):
        drag = -np.clip(state.u, -0.2, 0.2) * abs(state.v) ** 1.5 + np.arctan2(state.y, 1.0)
        push = (inputs.left - inputs.right) / (1 + state.r**2) - np.hypot(state.x, 0.5 * inputs.lift)
        table = np.interp(state.psi, [-1.0, -0.2, 0.3, 0.9], [0.5, -0.1, 0.0, 2.0])
        return a * push, a * drag, -a * table * np.tanh(state.psi) * np.exp(-state.t)

    effect = ground.Effect("mine", force=force, a=(1.0, "N"))
    known = {"min": min, "max": max, "atan2": np.arctan2, "tanh": np.tanh, "exp": np.exp, "sqrt": np.sqrt}
    random = np.random.default_rng(1)
    for _ in range(20):
        state = dict(zip(("u", "v", "r", "x", "y", "psi", "t"), random.normal(size=7)))
        left, right, lift = random.random(3)
        names = {**state, **known, "u_L": left, "u_R": right, "lift": lift, "a": 0.7}
        wanted = force(Given(**state), Given(left=left, right=right, lift=lift), 0.7)
        for axis, value in zip("XYN", wanted):
            assert eval(effect.formulas[axis].replace("^", "**"), {}, names) == pytest.approx(value)


def test_a_choice_is_numpys_where(craft):
    def force(state, inputs, a):
        return np.where((state.x > 0.02) & (state.t < 5), a, -a * inputs.left), 0, 0

    effect = ground.Effect("mine", force=force, a=(0.01, "N"))
    same = ground.Effect("mine", X="x > 0.02 && t < 5 ? a : -a*u_L", a=(0.01, "N"))
    assert np.allclose(flown(craft + effect).eta, flown(craft + same).eta, atol=1e-9)


def branches(state, inputs):
    return (1.0 if state.x > 0 else 0.0), 0, 0


def takes_numbers(state, inputs):
    import math

    return math.sin(state.x), 0, 0


@pytest.mark.parametrize(
    "force,words",
    [
        (branches, "numpy.where"),
        (takes_numbers, "math.sin"),
        (lambda state, inputs: (state.z, 0, 0), "state has no z"),
        (lambda state, inputs: (state.x, 0), "must return X, Y, N"),
        (lambda state, inputs: state.x, "X, Y, N"),
        (lambda state, inputs: 1.0, "X, Y, N"),
        (lambda state, inputs: (inputs.lefft, 0, 0), "no lefft.*did you mean left.*left, right, lift"),
        (lambda state, inputs, p: (0, 0, p), r"force\(state, inputs\).*'p'"),
        (lambda state, inputs: (np.sum(state.x), 0, 0), "numpy.sum|numpy.add.reduce"),
        (lambda state, inputs: (np.interp(state.x, [1, 0], [0, 1]), 0, 0), "points that ascend"),
        (lambda state, inputs: (np.cumsum(state.x), 0, 0), "effect mine"),
        (lambda state, inputs: ("a", None, 0), "effect mine|not NoneType"),
        (lambda state: (0, 0, 0), "effect mine"),
        (lambda state, inputs: (0, 0, 0), "no force"),
    ],
)
def test_a_function_that_is_no_formula_is_refused_in_a_sentence(force, words):
    with pytest.raises(ground.GroundError, match=words) as error:
        ground.Effect("mine", force=force)
    assert "\n" not in str(error.value)


def test_a_function_is_called_by_the_names_of_its_parameters():
    with pytest.raises(ground.GroundError, match=r"force\(state, inputs, c\)"):
        ground.Effect("mine", force=lambda state, inputs, p: (p, 0, 0), c=(1.0, "N"))


@pytest.mark.parametrize("file", ["hovercraft/tiny_whoover.yaml", "craft/air_table.yaml"])
def test_a_misspelt_input_is_refused_with_the_names_that_exist(file):
    """In a formula, and in a function where the craft decides which names there are."""
    craft = ground.Model.load(ROOT / "cfg" / file)
    first = craft.core.thrusters[0]["name"]
    written = [
        ground.Effect("mine", X="a*u_%sx" % first, a=(1.0, "N")),
        ground.Effect("mine", force=lambda s, i, a: (a * getattr(i, "u_%sx" % first), 0, 0), a=(1.0, "N")),
    ]
    for effect in written:
        with pytest.raises(ground.GroundError) as error:
            craft + effect
        said = str(error.value)
        assert "u_%sx " % first in said and "u_%s" % first in said.replace("u_%sx" % first, ""), said
        assert "psi" in said and "lift" in said, said


def test_wrong_effects_are_refused(craft, tmp_path):
    (tmp_path / "list.yaml").write_text("- 1\n")
    (tmp_path / "odd.yaml").write_text("name: [\n")
    for wrong in (
        lambda: craft + "nothing",
        lambda: craft + ground.Effect("bad", X="a*", a=(1, "N")),
        lambda: craft + ground.Effect("bad", X="1 + a", a=(1, "N")),
        lambda: craft + ground.Effect("wind", wz=1.0),
        lambda: craft + "wind" + "wind",
        lambda: craft - "wind",
        lambda: ground.Effect("bad", X="a", a="N"),
        lambda: craft + "nothing.yaml",
        lambda: ground.Effect.load(tmp_path / "list.yaml"),
        lambda: ground.Effect.load(tmp_path / "odd.yaml"),
        lambda: craft + {"expression": {"X": "1"}},
    ):
        with pytest.raises(ground.GroundError):
            wrong()


@pytest.mark.parametrize(
    "make, words",
    [
        (lambda: ground.Effect("motor_lag", taus=0.3), r"no parameter taus \(did you mean tau\?\); it has"),
        (lambda: ground.Effect("motor_lagg", tau=0.3), r"no effect motor_lagg \(did you mean motor_lag\?\)"),
        (lambda: ground.Effect("mine", X="c*u+", c=(0.02, "N s/m")), "c\\*u\\+"),
        (lambda: ground.Effect("mine", X="c*q", c=(0.02, "N")), "there is no q"),
    ],
)
def test_an_effect_is_checked_when_it_is_made(make, words):
    with pytest.raises(ground.GroundError, match=words):
        make()


def test_the_library_is_a_table(craft):
    known = ground.effects()
    assert "wind" in known and known["wind"] in known and "winds" not in known and known[:1] == [known[0]]
    with pytest.raises(ground.GroundError, match="did you mean wind?"):
        known["windd"]
    assert known.title == "Effects of the library" and known.title in known._repr_html_()
    frame = known.to_frame()
    assert len(known) == len(frame) > 15
    assert "tau [s]" in frame.loc["motor_lag", "parameters"] and frame.meaning.str.len().min() > 5
    assert "<table" in known._repr_html_() and "motor_lag" in str(known)
    assert all((craft + effect).effects == (effect.name,) for effect in known)


def test_effects_of_a_craft_with_listed_thrusters():
    table = ground.Model.load(ROOT / "cfg" / "craft" / "air_table.yaml")
    name = table.core.thrusters[0]["name"]
    leak = ground.Effect("leak", N="a*u_%s" % name, a=(1e-3, "N m"))
    same = ground.Effect(
        "leak", force=lambda s, inputs, a: (0, 0, a * getattr(inputs, "u_" + name)), a=(1e-3, "N m")
    )
    assert (table + leak).effects == (table + same).effects == ("leak",)
    assert (table + ground.Effect("thruster_gain_" + name)).effects == ("thruster_gain_" + name,)
