"""The MuJoCo bench: its cases, its table, and its craft where MuJoCo is installed (make bench-mujoco)."""

import pathlib
import subprocess

import numpy as np
import pytest

import hidden_cases
import hidden_craft
import mujoco_bench
import mujoco_cases

ROOT = pathlib.Path(__file__).resolve().parents[2]
BENCH = ROOT / "test" / "bench"

PYTHON = ROOT / "build" / "peers" / "bin" / "python"


def has_mujoco():
    command = [str(PYTHON), "-c", "import mujoco"]
    return PYTHON.exists() and not subprocess.run(command, stderr=subprocess.DEVNULL).returncode


needs_mujoco = pytest.mark.skipif(
    not has_mujoco(), reason="MuJoCo is not in build/peers: test/bench/peer_python build/peers"
)


def test_a_quarter_of_the_cases_is_null_and_all_effects_take_their_turn():
    made = [mujoco_cases.make(seed)[0] for seed in range(1, 81)]
    kinds = [case.kind for case in made]
    assert kinds.count("mujoco_null") == kinds.count("mujoco_nameless") == 20
    assert {name for case in made for name in case.hidden} == set(mujoco_cases.LIBRARY)
    outside = [list(case.effects)[0] for case in made if case.kind == "mujoco_nameless"]
    assert set(outside) == set(mujoco_cases.NAMELESS)
    assert not any(case.effects for case in made if case.kind == "mujoco_null")


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


def result(kind, chosen, verdict, error):
    case, _ = mujoco_cases.make({"null": 1, "library": 2, "nameless": 3}[kind])
    found = {"chosen": chosen, "groups": {}, "verdict": verdict, "parameters": []}
    found["errors"] = {"steps": [error]}
    return dict(case.describe(), frame="body", found=found, true_error=1.0)


def test_the_table_counts_what_was_said():
    hidden = mujoco_cases.make(2)[0].hidden
    results = [
        result("null", [], "complete", 1.0),
        result("library", hidden, "missing", 1.1),
        result("nameless", [], "complete", 3.0),
    ]
    table = {line[0]: line[1:3] for line in mujoco_bench.lines(results)}
    assert table["effects of the library: right or inseparable"] == ["100.0%", "1"]
    assert table["all: a false effect"] == ["0.0%", "3"]
    assert table["error above 1.5 times the truth's: `complete`"] == ["100.0%", "1"]
    (wrong,) = mujoco_bench.wrong(results)
    assert "seed 3" in wrong and "compass" in wrong


def test_without_mujoco_one_line_says_so(tmp_path):
    command = [str(BENCH / "mujoco_bench.py"), "--python", "", "--results", str(tmp_path / "r.jsonl")]
    ended = subprocess.run(command, stderr=subprocess.PIPE, universal_newlines=True)
    assert ended.returncode and "MuJoCo" in ended.stderr and len(ended.stderr.splitlines()) == 1
