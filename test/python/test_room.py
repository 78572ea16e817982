"""identify simulate --room: excitation and tracking inside a room."""

import json

import numpy as np
import pytest

from conftest import MODEL, ROOT, identify
from test_identify import fails
from test_simulate import TRUTH, messages, simulate

ROOM = ROOT / "cfg" / "room" / "room_4x4.yaml"
BURSTS = "/bursts"


def clearances(path, half=2.0):
    """Distances of the true craft from the walls of a square room in the middle [m]."""
    eta = np.array([message.eta for _, message in messages(path)[TRUTH]])
    return half - np.abs(eta[:, :2]).max(axis=1)


@pytest.fixture(scope="module")
def excited(tmp_path_factory):
    """Bag of 20 s of a PRBS in the room, and the output with --json."""
    folder = tmp_path_factory.mktemp("excited")
    return simulate(folder, "prbs", "--room", ROOM)


def test_an_excitation_stays_inside_and_one_without_a_room_does_not(excited, tmp_path):
    path, result = excited
    assert result["stopped"] is None
    near = clearances(path)
    assert near.min() > 0.2
    assert near.max() - near.min() > 0.5, "the craft moves"
    open_loop, _ = simulate(tmp_path, "prbs")
    assert clearances(open_loop).min() < 0


def test_the_bag_has_the_bursts(excited):
    path, result = excited
    found = messages(path)
    marks = found[BURSTS]
    assert result["messages"] == {topic: len(rows) for topic, rows in found.items()}
    assert marks[0][1]._type == "ground_msgs/Burst"
    assert [m.burst for _, m in marks] == [i % 2 == 0 for i in range(len(marks))]
    assert [m.number for _, m in marks] == [i // 2 + 1 for i in range(len(marks))]
    assert result["bursts"] == sum(m.burst for _, m in marks) >= 3
    times = np.array([t for t, _ in marks])
    assert times[0] == pytest.approx(1001.5, abs=0.02) and times[-1] < 1021.6
    assert (np.diff(times) >= 0).all()
    for received, message in marks:
        assert message.header.stamp.to_sec() == received
        assert message.reason
    reasons = {m.reason for _, m in marks[1:]}
    assert reasons <= {
        "the craft is home",
        "the way home would come close to a wall",
        "the burst has lasted long enough",
    }


def test_a_fit_reads_a_bag_of_bursts(excited, tmp_path):
    path, _ = excited
    out = tmp_path / "fitted.yaml"
    result = identify("fit", path, "--model", MODEL, "-o", out, "--json")
    assert result.returncode == 0, result.stderr
    fit = json.loads(result.stdout)["parameters"]
    assert fit["k"]["value"] == pytest.approx(0.062, rel=0.03)
    assert fit["I_z"]["value"] == pytest.approx(8.8e-5, rel=0.03)


def test_a_tracking_controller_stays_inside(tmp_path):
    options = ["--room", ROOM, "--controller", "ModelPredictive", "--size", 1.5]
    path, result = simulate(tmp_path, "tracking", *options, "--duration", 10)
    assert result["stopped"] is None and result["bursts"] == 0
    assert clearances(path).min() > 0.2


def test_a_craft_that_would_leave_is_stopped_and_the_run_is_kept(tmp_path):
    out = tmp_path / "run.bag"
    result = identify(
        *["simulate", "--model", MODEL, "--input", "prbs", "--room", ROOM, "-o", out],
        *["--start-velocity", 3, 0, 0],
    )
    assert result.returncode == 0, result.stderr
    (message,) = result.stderr.strip().splitlines()
    assert message.startswith("identify simulate: the controller stopped: ")
    assert "of the room" in message
    assert out.exists()


def refused(tmp_path, *options):
    """Runs simulate, which must not write a bag; returns the result."""
    out = tmp_path / "refused.bag"
    result = identify("simulate", "--model", MODEL, "-o", out, *options)
    assert not out.exists()
    return result


def test_options_that_do_not_go_together_are_refused(tmp_path):
    prbs = ["--input", "prbs"]
    fails(refused(tmp_path, *prbs, "--burst", 2), "--burst needs --room", status=2)
    for bad in (0, -1, "long", "nan"):
        result = refused(tmp_path, *prbs, "--room", ROOM, "--burst", bad)
        fails(result, "--burst", status=2)
    tracking = ["--input", "tracking", "--room", ROOM]
    fails(refused(tmp_path, *tracking, "--burst", 2), "--burst does not go with", status=2)


def test_a_reference_too_large_for_the_room_is_refused_with_one_line(tmp_path):
    for size in (1.9, 2.5):
        result = refused(tmp_path, "--input", "tracking", "--room", ROOM, "--size", size)
        fails(result, "the reference does not fit into", "room_4x4.yaml", "m outside", status=2)
        assert "does not fit" in result.stderr.strip().splitlines()[-1]
    shifted = ["--input", "tracking", "--room", ROOM, "--size", 1.5, "--origin", 0.6, 0]
    fails(refused(tmp_path, *shifted), "the reference does not fit into", status=2)


@pytest.mark.parametrize(
    "old, new, words",
    [
        ("margin: 0.2", "margin: wide", "margin must be a number"),
        ("braking:", "breaking:", "unknown key 'breaking'"),
        ("home: [0, 0] ", "home: [9, 0] ", "home must be inside"),
    ],
)
def test_a_bad_room_file_is_named_with_its_line(tmp_path, old, new, words):
    text = ROOM.read_text()
    assert text.count(old) == 1
    bad = tmp_path / "bad.yaml"
    bad.write_text(text.replace(old, new))
    line = text[: text.index(old)].count("\n") + 1
    result = refused(tmp_path, "--input", "prbs", "--room", bad)
    fails(result, "bad.yaml, line %d: " % line, words)


def test_a_missing_room_file_is_named(tmp_path):
    for kind in ("prbs", "tracking"):
        fails(refused(tmp_path, "--input", kind, "--room", tmp_path / "none.yaml"), "none.yaml")
