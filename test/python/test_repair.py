"""Repair of poses, on made-up recordings whose truth is known."""

import numpy as np
import pytest

from conftest import identify, recording_of, simulate_run, succeeds
from ground.poses import angles, headings
from ground.support.errors import GroundError

COUNTED = (
    "stamps put in order",
    "duplicates dropped",
    "frozen poses dropped",
    "headings mirrored back",
    "poses that overtook each other put in order",
    "positions held between fixes left out",
)


def moving(duration=6.0, noise=1.0):
    """Stamps, poses and commands of a craft that moves from the first pose on."""
    return simulate_run(duration=duration, noise=noise, nu=(0.3, 0.0, 0.5))


def repaired(times, eta, inputs, **more):
    return recording_of(times, eta, inputs, **more).motion


def off(measured, true):
    """Largest difference of headings, up to whole turns."""
    return np.abs(angles.wrap(measured - true)).max()


def test_a_sound_recording_is_smoothed_and_nothing_is_repaired():
    times, eta, inputs = moving()
    _, true, _ = moving(noise=0)
    found = repaired(times, eta, inputs)
    assert found.repairs == dict.fromkeys(COUNTED, 0)
    assert np.array_equal(found.times, times) and found.clock is None
    assert not found.jumps.any() and not len(found.spikes)
    assert found.noise[0] == pytest.approx(3e-4, rel=0.15)
    assert found.noise[1] == pytest.approx(5e-3, rel=0.15)
    assert np.abs(found.eta - true)[:, :2].max() < 1e-3 and off(found.eta[:, 2], true[:, 2]) < 0.015
    assert np.abs(np.diff(found.measured[:, 2])).max() < np.pi
    world = np.gradient(true[:, :2], times, axis=0)
    c, s = np.cos(true[:, 2]), np.sin(true[:, 2])
    u, v = c * world[:, 0] + s * world[:, 1], c * world[:, 1] - s * world[:, 0]
    inner = slice(20, -20)
    assert np.abs(found.nu[inner, 0] - u[inner]).max() < 0.05
    assert np.abs(found.nu[inner, 1] - v[inner]).max() < 0.05


def test_a_turned_moved_or_mirrored_room_changes_no_velocity():
    times, eta, inputs = moving(3.0)
    plain = repaired(times, eta, inputs)
    c, s = np.cos(0.7), np.sin(0.7)
    turned = eta @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) + [2.0, -1.0, 0.7]
    found = repaired(times + 100, turned, inputs)
    assert np.allclose(found.nu, plain.nu, atol=2e-4)
    assert np.allclose(found.times, plain.times + 100)
    mirrored = repaired(times, eta * [1, -1, -1], inputs)
    assert np.allclose(mirrored.nu, plain.nu * [1, -1, -1], atol=1e-9)
    assert np.allclose(mirrored.nu_dot, plain.nu_dot * [1, -1, -1], atol=1e-9)


@pytest.mark.parametrize("offset,shift", [(0.05, 0), (0.051, 0.051), (-0.05, 0), (-2.0, -2.0)])
def test_poses_on_another_clock_are_shifted_to_that_of_the_commands(offset, shift):
    times, eta, inputs = moving(2.0)
    found = repaired(times, eta, inputs, clock_offset=offset)
    assert np.allclose(found.times, times + shift)
    assert found.repairs.get("poses shifted to the clock of the commands [s]", 0) == shift


def test_a_turn_of_the_craft_is_no_mirrored_heading():
    times = np.arange(400) / 100
    eta = np.column_stack([0.3 * times, 0 * times, 2 * np.sin(2 * times)])
    eta += np.random.default_rng(1).normal(0, [3e-4, 3e-4, 5e-3], eta.shape)
    inputs = np.array([[0.0, 0.5, 0.5, 1.0], [4.0, 0.5, 0.5, 1.0]])
    assert repaired(times, eta, inputs).repairs["headings mirrored back"] == 0


def test_spikes_are_left_out_and_not_followed():
    times, eta, inputs = moving(3.0)
    plain = repaired(times, eta, inputs)
    at = [50, 140, 141, 250]
    damaged = eta.copy()
    damaged[at] += [0.3, -0.2, 0.0]
    found = repaired(times, damaged, inputs)
    assert found.spikes == pytest.approx(times[at])
    assert np.abs(found.eta - np.delete(plain.eta, at, axis=0)).max() < 2e-3


def test_motion_restarts_where_the_craft_is_carried_away():
    times, eta, inputs = moving(3.0)
    carried = eta.copy()
    carried[150:, :2] += [1.5, 0.0]
    found = repaired(times, carried, inputs)
    assert np.flatnonzero(found.jumps).tolist() == [150]
    gap = np.r_[0:150, 180:300]  # poses are missing meanwhile: nothing is said of a jump
    assert not repaired(times[gap], carried[gap], inputs).jumps.any()


def test_too_few_poses_are_named():
    times, eta, inputs = moving(2.0)
    with pytest.raises(GroundError, match="run: only 9 distinct poses"):
        repaired(times[:9], eta[:9], inputs)
    assert len(repaired(times[:10], eta[:10], inputs).times) == 10


# --- headings of a mocap that takes one pattern of markers for another


def turned_back(times, psi):
    """What becomes of headings of a craft that stays at its place."""
    return headings.turned_back(times, np.column_stack([0 * psi, 0 * psi, psi]), 25.0)


@pytest.mark.parametrize("angle", [np.pi, np.pi / 2, -np.radians(60)])
@pytest.mark.parametrize("lost", [0, 5])
def test_a_heading_that_steps_is_turned_back_to_that_of_the_longest_part(angle, lost):
    times, eta, inputs = moving()
    sound = repaired(times, eta, inputs)
    turned = eta.copy()
    turned[:200, 2] += angle
    kept = np.ones(len(times), bool)
    kept[200 : 200 + lost] = False
    found = repaired(times[kept], turned[kept], inputs)
    ((when, step),) = found.heading_steps
    assert when == pytest.approx(times[200 + lost]) and abs(angles.wrap(step + angle)) < 0.03
    off = angles.wrap(found.measured[:, 2] - sound.measured[kept, 2])
    assert np.abs(off).max() < 0.03 and not found.jumps.any()


def test_parts_that_are_turned_are_turned_back():
    times, eta, inputs = moving()
    turned = eta.copy()
    turned[100:180, 2] += np.pi / 2
    turned[400:, 2] -= np.pi / 2
    found = repaired(times, turned, inputs)
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
    succeeds("info", tmp_path / "run.csv", "--write-mapping", tmp_path / "mapping.yaml")
    result = identify("info", tmp_path / "run.csv", "--mapping", tmp_path / "mapping.yaml")
    assert "one pattern of markers for another" in " ".join(result.stdout.split()), result.stdout
