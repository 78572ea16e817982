"""Headings of a mocap that takes one pattern of markers for another."""

import numpy as np
import pytest

from conftest import identify, recording_of, simulate_run
from ground.poses import angles, headings


def turned_back(times, psi):
    """What becomes of headings of a craft that stays at its place."""
    return headings.turned_back(times, np.column_stack([0 * psi, 0 * psi, psi]), 25.0)


def moving(**more):
    return simulate_run(duration=6.0, nu=(0.3, 0.0, 0.5), **more)


@pytest.mark.parametrize("angle", [np.pi, np.pi / 2, -np.radians(60)])
@pytest.mark.parametrize("lost", [0, 5])
def test_a_heading_that_steps_is_turned_back_to_that_of_the_longest_part(angle, lost):
    times, eta, inputs = moving()
    sound = recording_of(times, eta, inputs).motion
    turned = eta.copy()
    turned[:200, 2] += angle
    kept = np.ones(len(times), bool)
    kept[200 : 200 + lost] = False
    found = recording_of(times[kept], turned[kept], inputs).motion
    ((when, step),) = found.heading_steps
    assert when == pytest.approx(times[200 + lost]) and abs(angles.wrap(step + angle)) < 0.03
    off = angles.wrap(found.measured[:, 2] - sound.measured[kept, 2])
    assert np.abs(off).max() < 0.03 and not found.jumps.any()


def test_parts_that_are_turned_are_turned_back():
    times, eta, inputs = moving()
    turned = eta.copy()
    turned[100:180, 2] += np.pi / 2
    turned[400:, 2] -= np.pi / 2
    found = recording_of(times, turned, inputs).motion
    assert [round(np.degrees(step), -1) for _, step in found.heading_steps] == [90, -90, -90]
    assert np.abs(angles.wrap(found.measured[:, 2] - eta[:, 2])).max() < 0.05


@pytest.mark.parametrize("rate", [1.0, 8.0, 25.0])
def test_a_craft_that_is_struck_or_turns_fast_keeps_its_heading(rate):
    """A blow changes how fast the craft turns, not where it looks."""
    random = np.random.default_rng(3)
    times = np.arange(0, 6, 0.01)
    psi = rate * np.abs(times - 3) + random.normal(0, 5e-3, len(times))
    assert turned_back(times, psi) == (pytest.approx(psi), [], [])
    rare = times[::10]  # 10 Hz
    slow = 0.1 * rate * np.sin(3 * rare)
    assert turned_back(rare, slow)[1] == []


def test_every_verb_says_that_the_heading_stepped(tmp_path):
    times, eta, inputs = moving()
    eta[450:, 2] += np.pi
    rows = ["t,x,y,psi,left,right"]
    at = np.maximum(np.searchsorted(inputs[:, 0], times, side="right") - 1, 0)
    rows += ["%.4f,%.6f,%.6f,%.6f,%g,%g" % (t, *pose, *inputs[i, 1:3]) for t, pose, i in zip(times, eta, at)]
    (tmp_path / "run.csv").write_text("\n".join(rows) + "\n")
    result = identify("info", tmp_path / "run.csv", "--write-mapping", tmp_path / "mapping.yaml")
    assert result.returncode == 0, result.stderr
    result = identify("info", tmp_path / "run.csv", "--mapping", tmp_path / "mapping.yaml")
    assert "one pattern of markers for another" in " ".join(result.stdout.split()), result.stdout
