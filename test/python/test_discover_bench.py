"""The discovery bench: its craft in a control loop, its floor, and one short discovery."""

import json
import sys

import numpy as np
import pytest

import discover
import discover_cases as cases
import discover_floor
import discover_lab
import hidden_craft
import hidden_score
from conftest import slow
from ground import _core
from ground.discovery import analyst
from ground.recordings.quality import repaired
from ground.simulation import experiments

ROOM = _core.load_room(discover.ROOM)


def true_model(case):
    model = cases.given_model()
    for name, value in case.body.items():
        model.set_value(name, value)
    return model


def prbs(seconds=4.0):
    return experiments.with_lift(experiments.rows("prbs", seconds, clock=10, seed=3), seconds)


def played(case, drive=None):
    """The run and the lab of one flight; a random sequence without a room by default."""
    lab = discover_lab.HiddenLaboratory(case, cases.given_model(), ROOM)
    run = lab.simulated(drive or prbs(), "test", 1)
    return run, lab


def test_a_craft_without_effects_moves_like_the_model():
    case = cases.make("none", 1)
    case.level = 0.0
    run, lab = played(case)
    model = true_model(case)
    own = experiments.simulate(model, prbs(), pose=run.truth_eta[0], mocap=lab.mocap)
    np.testing.assert_array_equal(run.controls, own.controls)
    np.testing.assert_allclose(run.truth_eta, own.truth_eta, atol=2e-3)
    lifted = run.truth_times < run.control_times[run.controls[:, 2] > 0][-1]
    np.testing.assert_allclose(run.truth_eta[lifted], own.truth_eta[lifted], atol=1e-4)
    np.testing.assert_allclose(run.truth_nu[lifted], own.truth_nu[lifted], atol=1e-3)
    noise = run.eta - run.truth_eta[np.searchsorted(run.truth_times, run.pose_times)]
    noise[:, 2] = np.angle(np.exp(1j * noise[:, 2]))
    assert noise.std(axis=0) == pytest.approx([3e-4, 3e-4, 5e-3], rel=0.15)


@pytest.mark.parametrize("kind, seed", [("memory", 4), ("three", 2)])
def test_step_by_step_it_moves_as_under_known_commands(kind, seed):
    case = cases.make(kind, seed)
    case.level = 0.0
    run, lab = played(case)
    states = lab.flown[0][1]
    sent = np.column_stack([run.control_times - experiments.START, run.controls])
    began = sent[np.argmax(sent[:, 3] > 0), 0]
    commands = hidden_craft.acting(case.effects, sent)
    end = sent[sent[:, 3] > 0][-1, 0]  # then the floor brakes
    craft = hidden_craft.Craft(case.body, case.effects)
    motion = hidden_craft.simulate(craft, commands, end, run.truth_eta[0], began)
    at = states[(states[:, 0] >= began + 0.2) & (states[:, 0] <= end)]
    np.testing.assert_allclose(motion.poses(at[:, 0]), at[:, 1:4], atol=1e-4)
    moved = np.ptp(at[:, 1:3], axis=0)
    assert moved.max() > 0.5


@pytest.mark.parametrize("effect, seed, most", [("motor_lag", 2, 0.6)])
def test_the_floor_is_the_error_of_the_true_motion(effect, seed, most):
    """With an effect of the library, the project's own true model has the same error."""
    case = cases.make("one", seed)
    assert list(case.effects) == [effect]
    run, lab = played(case)
    data = repaired(run).data(cases.given_model())
    truth = true_model(case)
    nominal = analyst.error(data, truth)
    for name, parameters in case.effects.items():
        truth.add_effect(name)
        for parameter, value in parameters.items():
            truth.set_value("%s.%s" % (name, parameter), value)
    floor = discover_floor.true_error(case, lab.flown[0], cases.given_model())
    assert floor == pytest.approx(analyst.error(data, truth), rel=0.02)
    assert floor < most * nominal


def test_cases_follow_from_their_seeds():
    for kind in cases.KINDS:
        assert cases.make(kind, 3) == cases.make(kind, 3)
        assert cases.make(kind, 3).body != cases.make(kind, 4).body
    assert len(cases.make("two", 1).effects) == 2
    every = {name for seed in range(1, 6) for name in cases.make("memory", seed).effects}
    assert every == set(cases.MEMORY)


@slow
def test_crafts_find_their_effects(monkeypatch, tmp_path, capsys):
    """Short discoveries; `make bench-discover` runs whole ones. A flight of 15 s may name an effect too many
    (1 of 16 seeds), and one of seven tenths of what matters is too small: most of three must be right."""
    monkeypatch.setitem(cases.KINDS, "one", (cases.one, 3, 48.0))
    options = ["--kinds", "one", "--choosers", "informed", "--jobs", "1"]
    path = tmp_path / "results.jsonl"
    monkeypatch.setattr(sys, "argv", ["discover.py", *options, "--results", str(path)])
    assert discover.main() is None
    results = [json.loads(line) for line in path.read_text().splitlines()]
    assert len(results) == 3 and sum(map(hidden_score.is_right, results)) >= 2
    assert sum(set(result["hidden"]) <= set(result["found"]["chosen"]) for result in results) >= 2
    for result in results:
        assert result["clearance"] > 0
        assert result["tracking"]["after"] < result["tracking"]["before"]
        assert result["confirmation"]["final"] < 1.2 * result["confirmation"]["truth"]
    said = capsys.readouterr().out
    assert "one effect: right or a group, in time" in said
    assert discover.main() is None
    assert "0 of them to do" in capsys.readouterr().out
