"""Mistakes in units, axes, signs, clocks and swaps are named with their remedy; honest runs are not."""

import re
import sys

import numpy as np
import pytest
from conftest import MODEL, ROOT, identify
from ground.recordings import units

import ground

sys.path.insert(0, str(ROOT / "test" / "bench"))
import mistakes

NAMES = [name for name, _, _ in mistakes.MISTAKES]


@pytest.mark.parametrize("number", range(len(NAMES)), ids=NAMES)
def test_a_mistake_is_named_with_its_remedy(number, tmp_path):
    name, named, said = mistakes.mistaken(number, tmp_path / "run")
    assert name == NAMES[number]
    assert named, said


@pytest.mark.parametrize("number", range(4))
def test_an_honest_run_is_not_suspected(number, tmp_path):
    lines, said = mistakes.honest(number, tmp_path / "run")
    assert lines == [] and "reply" in said


REMEDIES = {
    "swapped": (
        "left: {field: left}, right: {field: right}",
        "left: {field: right}, right: {field: left}",
    ),
    "inverted": (
        "{field: left}, right: {field: right}",
        "{field: left, off: 1, full: 0}, right: {field: right, off: 1, full: 0}",
    ),
    "half a turn": ('axes: "x, z, -y"', 'axes: "x, z, -y"\n  heading_offset: 3.14'),
    "yaw": ("field: psi", "field: psi, sign: -1"),
    "mirror": ("[x, y]", '[x, "-y"]'),
    "millimetres": ("[px, py, pz]", "[px, py, pz], unit: mm"),
    "degrees": ("field: psi", "field: psi, unit: deg"),
    "percent": ("field: left", "field: left, unit: percent"),
    "axes": ('"x, z, -y"', '"x, -y, -z"'),
}


@pytest.mark.parametrize("name", REMEDIES)
def test_the_remedy_mends_it(name, tmp_path):
    number = NAMES.index(name)
    run = mistakes.Recorded(number)
    mistakes.MISTAKES[number][1](run)
    folder, mapping = run.write(tmp_path / "run")
    text = mapping.read_text()
    before, after = REMEDIES[name]
    assert before in text
    text = text.replace(before, after)
    if name == "percent":
        text = re.sub(r"field: (right|lift)", r"field: \1, unit: percent", text)
    mapping.write_text(text)
    (found,) = ground.read(folder, mapping=mapping)
    assert found.repaired.suspicions == []
    honest = mistakes.Recorded(number)
    assert found.eta[:, :2] == pytest.approx(honest.eta[:, :2], abs=1e-9)
    assert found.controls == pytest.approx(honest.commands[:, 1:], abs=1e-9)


def test_fit_and_compare_say_it_and_change_nothing(tmp_path):
    run = mistakes.Recorded(3)
    mistakes.swapped(run)
    folder, mapping = run.write(tmp_path / "run")
    options = ("--mapping", mapping, "--model", MODEL)
    result = identify("fit", folder, *options, "-o", tmp_path / "fitted.yaml")
    assert result.returncode == 0
    assert result.stderr.count("left and right seem to be swapped") == 1
    result = identify("compare", folder, *options, "--numbers", "-o", tmp_path / "compared")
    assert result.returncode == 0
    assert result.stderr.count("left and right seem to be swapped") == 1
    (found,) = ground.read(folder, mapping=mapping)
    assert np.array_equal(found.controls, run.commands[:, 1:])


def test_units_are_told_by_speed_and_noise():
    times = np.arange(0, 10, 0.01)
    path = 0.8 * np.column_stack([np.cos(times), np.sin(times)])
    assert units.length_unit(times, path, 3e-4)[0] is None
    assert units.length_unit(times, 1e3 * path, 0.3)[0] == "mm"
    assert units.length_unit(times, 1e2 * path, 0.03)[0] == "cm"
    assert units.length_unit(times, 300 * path, 0.3)[0] == "mm"
    assert units.command_unit(np.array([1000.0, 1500])) == "microseconds"
    assert units.command_unit(np.array([0.0, 80])) == "percent"
    assert units.command_unit(np.array([-1.0, 0.5])) == "normalised"
    assert units.command_unit(np.array([0.0, 255])) is None
    assert units.upside_down("x, z, -y") == "x, -z, y"


def test_the_real_runs_of_a_turned_mocap_are_suspected_and_the_others_are_not(tmp_path, recordings):
    from conftest import SHARED

    for stamp in recordings:
        files = [SHARED / ("%s_%s.csv" % (kind, stamp)) for kind in ("controls", "pose")]
        bag = tmp_path / (stamp + ".bag")
        assert identify("import", *files, "-o", bag).returncode == 0
        (run,) = ground.read(bag)
        kinds = [s.kind for s in run.repaired.suspicions]
        assert kinds == (["offset"] if stamp.startswith("2019-04-11") else []), stamp
