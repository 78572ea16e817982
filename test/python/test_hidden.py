"""The benches of hidden effects: craft, cases, scores, table; `make bench-hidden`, `bench-mujoco` measure."""

import json
import pathlib
import subprocess

import numpy as np
import pytest

import hidden
import hidden_cases
import hidden_craft
import hidden_effects
import hidden_judge
import hidden_score
import mujoco_cases
import resumed
from ground import _core

BENCH = pathlib.Path(__file__).resolve().parents[1] / "bench"

BODY = {name: _core.load_model(hidden_effects.MODEL).value(name) for name in hidden_cases.NOMINAL}
BEGAN, END = 0.5, 3.5  # begin and end of the test drives [s]


def commands(lift=0.8):
    """Rows time, left, right, lift of a random drive that begins with its lift."""
    edges = np.arange(BEGAN, END, 0.13)
    levels = np.random.default_rng(1).uniform(0, 1, (len(edges), 2))
    return np.column_stack([edges, levels, np.full(len(edges), lift)])


def large(effects):
    """Parameters of effects at four times their strength, {effect: {parameter: value}}."""
    return {
        effect: {
            name: hidden_effects.scaled(effect, name, size, 4.0)
            for name, size in hidden_effects.STRENGTHS[effect].items()
        }
        for effect in effects
    }


def moved(effects, wrench=None, max_step=hidden_craft.COARSE):
    """The Motion of the bench's craft in the test drive."""
    reach = hidden_craft.acting(effects, commands())
    craft, start = hidden_craft.Craft(BODY, effects), (0.1, 0.2, 0.7)
    return hidden_craft.simulate(craft, reach, END, start, BEGAN, wrench=wrench, max_step=max_step)


def by_core(effects, times):
    """Measured poses of the same drive at given times, by the project's core."""
    model = _core.load_model(hidden_effects.MODEL)
    for effect, parameters in effects.items():
        model.add_effect(effect)
        for name, value in parameters.items():
            model.set_value("%s.%s" % (effect, name), value)
    start = np.array([0.1, 0.2, 0.7])
    return _core.simulate(model, commands(), times, start, np.zeros(3), [BEGAN])["eta"]


def pose_difference(effects):
    """Largest difference of poses between the bench's craft and the core [m], [rad]."""
    motion = moved(effects)
    return np.abs(hidden_craft.seen(effects, motion.eta) - by_core(effects, motion.times)).max()


@pytest.mark.parametrize("effect", sorted(hidden_effects.strengths()))
def test_the_craft_and_the_core_agree_on_each_effect(effect):
    effects = large([effect])
    assert pose_difference(effects) < 1e-4
    seen = hidden_craft.seen(effects, moved(effects).eta)
    assert np.abs(seen[-1] - moved({}).eta[-1]).max() > 3e-3  # the effect changes the motion


def test_the_bench_has_every_effect_that_is_tried_by_default():
    floor = {name for name, effect in _core.effects().items() if effect["surroundings"] != "water"}
    known = {*hidden_effects.STRENGTHS, *hidden_effects.OF_CRAFT}
    assert floor - known <= {"floor_friction_map", "battery_voltage"}


@pytest.mark.parametrize(
    "effect, parameters",
    [
        ("motor_rise_fall", {"rise": 0.07, "fall": 0.02}),
        ("motor_rate", {"rate": 5.0}),
        ("supply_sag", {"part": 0.3, "time": 0.5}),
        ("thrust_droop", {"part": 0.3, "time": 0.5}),
    ],
)
def test_the_judge_moves_a_craft_with_the_memory_of_thrusters_as_the_core_does(effect, parameters):
    model = _core.load_model(hidden_effects.MODEL)
    model.add_effect(effect)
    for name, value in parameters.items():
        model.set_value("%s.%s" % (effect, name), value)
    motion = moved(hidden_judge.craft_of(model).effects, max_step=hidden_judge.SHORT)
    assert np.abs(motion.eta - by_core({effect: parameters}, motion.times)).max() < 5e-3
    assert np.abs(motion.eta[-1] - moved({}).eta[-1]).max() > 0.02


@pytest.mark.parametrize(
    "outside, library",
    [
        ({"spin_up": {"rise": 0.03, "fall": 0.03}}, {"motor_lag": {"tau": 0.03}}),
        ({"unequal_delays": {"left": 0.02, "right": 0.02}}, {"input_delay": {"delay": 0.02}}),
        ({"thrust_droop": {"part": 0.0, "time": 1.0}}, {}),
        ({"warm_up": {"part": 0.0, "use": 1.0}}, {}),
        ({"skirt_pressure": {"drag": 0.0, "time": 1.0, "speed": 1.0}}, {}),
        ({"thrust_backlash": {"width": 0.0}}, {}),
        ({"floor_field": {"force": 0.0, "length": 1.0, "phase": 0.3}}, {}),
        ({"thrust_scale": {"a": 0.0}}, {}),
        ({"slew": {"rate": 1e6}}, {"motor_lag": {"tau": hidden_craft.SLEWS}}),
        ({"supply_sag": {"part": 0.0, "time": 1.0}}, {}),
        ({"dead_zone": {"start": 0.0, "stop": 0.0}}, {}),
        ({"coarse_commands": {"steps": 10**9}}, {}),
        ({"later_thrust": {"at": 0.0, "left": 1.1, "right": 0.9}}, {"thrust_asymmetry": {"a": 0.1}}),
        ({"later_wrench": {"at": 0.0, "drag": 0.0, "moment": 2e-5}}, {"yaw_bias": {"n0": 2e-5}}),
        ({"later_wrench": {"at": END, "drag": 1.0, "moment": 1.0}}, {}),
    ],
)
def test_effects_outside_the_library_have_the_expected_limits(outside, library):
    ends = [moved(effects).eta[-1] for effects in (outside, library)]
    # The library's delay also delays the lift, which has no influence here.
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-7)


@pytest.mark.parametrize("kind", ["disturbed_single", "follows_path", "smoothed_late", "trim"])
def test_kind_and_seed_determine_a_case(kind):
    case, again, other = (hidden.KINDS[kind][0](kind, seed).describe() for seed in (3, 3, 4))
    assert case == again
    assert case["body"] != other["body"] and case["runs"] != other["runs"]
    assert json.loads(json.dumps(case)) == case  # the file of results holds JSON
    assert set(case["hidden"]) <= set(case["effects"])


def judged(kind, seed, run=3, unsmoothed=False):
    """A case, its Blocks of a fresh run for a horizon of 1 s, and the model with its library effects."""
    case = hidden.KINDS[kind][0](kind, seed)
    model = hidden_cases.given_model(case)
    for name, value in case.body.items():
        model.set_value(name, value)
    for effect in case.hidden:
        model.add_effect(effect)
        for name, value in case.effects[effect].items():
            model.set_value("%s.%s" % (effect, name), value)
    return case, hidden_judge.Blocks(case, run, hidden_cases.fly(case, run), 1.0, unsmoothed), model


@pytest.mark.parametrize("kind, seed", [("nothing", 2), ("library", 4), ("holds_place", 2), ("library", 21)])
def test_the_right_model_predicts_fresh_runs_as_the_true_craft_does(kind, seed):
    _, blocks, model = judged(kind, seed)
    of_model = blocks.errors_of(hidden_judge.craft_of(model))
    np.testing.assert_allclose(of_model, blocks.errors_of_truth(), rtol=0.02, atol=1e-4)
    assert len(of_model) > 10


@pytest.mark.parametrize("kind", ["smoothed_late", "smoothed_both"])
def test_the_right_model_predicts_poses_as_they_were_before_the_mocap_smoothed_them(kind):
    _, blocks, model = judged(kind, 7, unsmoothed=True)
    of_model = blocks.errors_of(hidden_judge.craft_of(model))
    np.testing.assert_allclose(of_model, blocks.errors_of_truth(), rtol=0.02, atol=1e-4)


@pytest.mark.parametrize(
    "chosen, hidden_ones, gap, improved, said, following, flags",
    [
        (["a"], ["a"], [-0.5, 0.1], 1.0, "a. Very certain.", "nothing needed", []),
        (["a"], ["a"], [0.5, 0.1], 1.5, "a. Likely.", "record more", ["WORSE"]),
        (["a"], ["a"], [0.15, 0.1], 1.5, "a. Certain.", "record more", []),
        (["a"], [], [0.5, 0.1], 1.5, "a. Certain.", "record more", ["WORSE", "FALSE", "CONFIDENT"]),
        (["a"], [], [0.0, 0.1], 1.0, "a. Certain by its likelihood; no.", "record more", ["FALSE"]),
        ([], ["a"], [0.0, 0.1], 2.5, "nothing.", "nothing needed", ["CONFIDENT"]),
        ([], ["a"], [0.0, 0.1], 2.5, "cannot be decided.", "record more", []),
    ],
)
def test_flags_say_what_is_wrong_with_an_answer(chosen, hidden_ones, gap, improved, said, following, flags):
    one = result(hidden_ones, chosen)
    one["found"]["lines"] = [["Missing", said], ["Next", following]]
    one["errors"] = {"truth": 1.0, "improved": improved, "gap": gap}
    assert hidden_judge.flags(one) == flags


def result(hidden=(), chosen=(), groups=None, **more):
    """A result as the bench writes it."""
    found = {"chosen": list(chosen), "groups": groups or {}, "verdict": "missing", "first": []}
    found.update(parameters=[], p_values={}, varies=None, memory=None, seconds=1.0)
    found["errors"] = {"fit": [1.0, 0.5], "steps": [1.0, 0.5]}
    found.update({name: more.pop(name) for name in list(more) if name in found})
    shared = {"kind": "pairs", "seed": 1, "allowed": [], "effects": {}, "level": 0.0}
    return dict(shared, hidden=list(hidden), found=found, **more)


def test_scores_of_sets_and_groups():
    exact = result(["a", "b"], ["b", "a"])
    assert hidden_score.is_exact(exact) and hidden_score.is_right(exact)
    group = result(["a", "b"], ["a"], {"a": ["a", "b"]})
    assert hidden_score.is_right(group) and not hidden_score.is_exact(group)
    missed = result(["a", "b"], ["a"])
    assert not hidden_score.is_found(missed) and not hidden_score.false_effects(missed)
    other = result(["a"], ["a", "c"])
    assert hidden_score.is_found(other) and not hidden_score.is_right(other)
    assert hidden_score.false_effects(other) == {"c"}
    equal = result(["a"], ["c"], {"c": ["c", "a"]})
    assert hidden_score.is_right(equal) and not hidden_score.is_exact(equal)
    assert hidden_score.is_right(result([], ["c"], allowed=["c"]))
    assert not hidden_score.is_right(result([], ["c"]))


def test_an_interrupted_bench_resumes(tmp_path):
    path = tmp_path / "results.jsonl"

    def bench(*more):
        command = [str(BENCH / "hidden.py"), "--kinds", "noise_null", "--count", "1"]
        command += ["--seed-base", "2", "--jobs", "1", "--results", str(path)] + list(more)
        return subprocess.check_output(command, text=True)

    assert "1 cases, 1 of them to do" in bench("--hours", "0")
    assert path.read_text() == ""
    path.write_text('{"kind": "noise_nu')  # a line cut when the bench was killed
    assert "noise_null: a false effect" in bench("--markdown", str(tmp_path / "table.md"))
    found = resumed.read(str(path))
    assert [(r["kind"], r["seed"]) for r in found] == [("noise_null", 2)]
    assert found[0]["found"]["verdict"] == "complete"
    assert "| noise_null: a false effect | 0.0% | 1 |" in (tmp_path / "table.md").read_text()
    before = path.read_text()
    assert "1 cases, 0 of them to do" in bench()
    assert path.read_text() == before


# --- the MuJoCo bench


ROOT = pathlib.Path(__file__).resolve().parents[2]

PYTHON = ROOT / "build" / "peers" / "bin" / "python"


def has_mujoco():
    command = [str(PYTHON), "-c", "import mujoco"]
    return PYTHON.exists() and not subprocess.run(command, stderr=subprocess.DEVNULL).returncode


needs_mujoco = pytest.mark.skipif(
    not has_mujoco(), reason="MuJoCo is not in build/peers: test/bench/peer_python build/peers"
)


@pytest.fixture
def engine_moves(tmp_path, monkeypatch):
    """Motion of the engine's craft without random wrench: moved(case) gives the run's times and poses."""

    def moved(case):
        del case.runs[1:]
        monkeypatch.setattr(hidden_cases, "FITTED", 1)
        mujoco_cases.record(case, "body", str(PYTHON), str(tmp_path))
        found = np.load(tmp_path / "moved.npz")
        return found["times 0"], found["eta 0"]

    return moved


# The engine's dry friction has an edge that the bench's craft rounds off.
@needs_mujoco
@pytest.mark.parametrize("effect", [None, *mujoco_cases.LIBRARY])
def test_the_engine_agrees_with_independent_equations(engine_moves, effect):
    seed = (
        1
        if effect is None
        else next(seed for seed in range(1, 81) if mujoco_cases.make(seed)[0].hidden == [effect])
    )
    case = mujoco_cases.make(seed)[0]
    for run in case.runs:
        run["push"] = {"sigma": [0.0] * 3, "time": [1.0] * 3, "white": [0.0] * 3, "trim": [0.0] * 3}
    times, eta = engine_moves(case)
    _, expected = hidden_cases.flight(case, 0)
    poses = hidden_craft.seen(case.effects, expected.poses(times[:3000]))
    nothing = hidden_cases.flight(case, 0, effects={})[1].poses(times[:3000])
    off, change = (np.abs(a - b).max() for a, b in ((eta[:3000], poses), (nothing, poses)))
    assert off < max(2e-4, 0.05 * change)
