"""Craft of other sizes, speeds and sensors are judged as a palm-sized hovercraft in one room is."""

import functools
from dataclasses import dataclass, replace

import numpy as np
import pytest

import ground
from conftest import MODEL, identify
from ground import _core
from ground.analysis import windows
from ground.checks import findings, quality, suspicions
from ground.poses import time_scales
from ground.reading.recording import Recording


@dataclass(frozen=True)
class Craft:
    """A craft with a left and a right thruster, and how it is recorded."""

    body: dict  # SI units
    rate: float  # of the poses [Hz]
    noise: tuple  # of positions [m] and headings [rad]
    held: float  # time for which a command is held [s]
    duration: float  # [s]

    def model(self):
        model = ground.Model.load(MODEL).core
        for name, value in self.body.items():
            model.set_value(name, value)
        return model

    def recorded(self, seed=1):
        """Stamps, poses and rows of commands."""
        random = np.random.default_rng(seed)
        edges = np.arange(0, self.duration, self.held)
        bits = random.integers(0, 2, (len(edges), 2)).astype(float)
        rows = np.column_stack([edges, bits, np.ones(len(edges))])
        times = np.arange(int(self.duration * self.rate)) / self.rate
        model = self.model()
        eta = _core.simulate(model, rows, times, np.zeros(3), np.zeros(3))["eta"]
        level = np.array(self.noise)[[0, 0, 1]]
        return times, eta + random.normal(0, level, eta.shape), rows


def body(*values):
    return dict(zip(("m", "l", "I_z", "X_u", "Y_v", "N_r", "k"), values))


CRAFT = {
    "palm-sized": Craft(
        body(0.0583, 0.0325, 8.8e-5, 0.0055, 0.0271, 4.6e-5, 0.062), 120, (3e-4, 5e-3), 0.1, 20
    ),
    "free-flyer": Craft(body(16, 0.1, 0.16, 0.3, 0.3, 0.008, 0.1), 120, (1.5e-5, 1e-4), 0.5, 60),
    "ship": Craft(body(3272, 1.0, 1e4, 60, 300, 2000, 40), 10, (0.01, 1e-3), 10, 900),
    "fast boat": Craft(body(180, 0.6, 120, 25, 300, 120, 80), 20, (0.02, 3e-3), 3, 240),
    "boat with GNSS": Craft(body(40, 0.2, 12, 30, 60, 6, 30), 5, (0.5, 5e-3), 6, 900),
}
every = pytest.mark.parametrize("name", CRAFT)
few = pytest.mark.parametrize("name", ["palm-sized", "ship", "boat with GNSS"])


def recording(craft, times, eta, rows, **more):
    return Recording("run", times, eta, rows[:, 0], rows[:, 1:], "made up", **more)


@functools.lru_cache(maxsize=None)
def sound(name):
    """A recording of a craft."""
    return recording(CRAFT[name], *CRAFT[name].recorded())


def described(run):
    return findings.described(quality.repaired(run))


@every
def test_sound_recordings_are_read_alike(name):
    craft, run = CRAFT[name], sound(name)
    found = quality.repaired(run)
    assert found.motion.noise == pytest.approx(craft.noise, rel=0.15)
    assert found.reply is not None and not found.contacts and not suspicions.of(run)
    assert found.usable() > 0.97 * craft.duration and len(found.spans) == 1
    assert not list(findings.grave(described(run)))


@every
def test_the_window_of_the_error_follows_the_craft(name):
    craft = CRAFT[name]
    usual = time_scales.usual_window(craft.model())
    assert usual == {"palm-sized": 1.5, "free-flyer": 30, "ship": 75}.get(name, 15)
    data = quality.repaired(sound(name)).data(craft.model())
    cut = windows.cut([data])
    assert windows.length([data]) == usual
    assert len(cut) == pytest.approx(craft.duration / usual, abs=2)


@every
def test_parameters_are_found(name):
    craft, run = CRAFT[name], sound(name)
    other = craft.model()
    other.set_value("k", 0.8 * craft.body["k"])
    fitted = ground.fit(ground.Model(other), run, free=["k", "I_z"])
    assert fitted.parameters["k"].value == pytest.approx(craft.body["k"], rel=0.05)
    assert fitted.parameters["I_z"].value == pytest.approx(craft.body["I_z"], rel=0.05)


def test_a_gap_is_some_intervals_long():
    craft = CRAFT["ship"]
    times, eta, rows = craft.recorded()
    kept = (times < 300) | (times > 304)
    found = quality.repaired(recording(craft, times[kept], eta[kept], rows))
    assert len(found.spans) == 2 and found.usable() == pytest.approx(craft.duration - 4, abs=12)


def test_positions_that_are_held_between_fixes_are_no_measurements():
    craft = replace(CRAFT["boat with GNSS"], rate=10)
    times, eta, rows = craft.recorded()
    eta[1::2, :2] = eta[::2, :2]  # a fix at 5 Hz, headings at 10 Hz
    run = recording(craft, times, eta, rows)
    assert described(run)["poses"]["held"] == len(times) // 2
    assert run.motion.noise == pytest.approx(craft.noise, rel=0.15)


@few
def test_frozen_poses_are_left_out_and_named(name):
    craft = CRAFT[name]
    times, eta, rows = craft.recorded()
    frozen = times > 0.8 * craft.duration
    eta[frozen] = eta[frozen][0]
    run = recording(craft, times, eta, rows)
    assert quality.repaired(run).usable() == pytest.approx(0.8 * craft.duration, rel=0.05)
    assert any("repeated while thrusters act" in line for line in findings.findings(described(run)))


@few
def test_a_pause_of_a_publisher_with_a_rate_is_left_out_and_named(name):
    craft = CRAFT[name]
    times, eta, rows = craft.recorded()
    sent = np.arange(0, craft.duration, craft.held / 4)
    sent = sent[(sent < 0.4 * craft.duration) | (sent > 0.6 * craft.duration)]
    at = np.searchsorted(rows[:, 0], sent + 1e-9, side="right") - 1
    again = np.column_stack([sent, rows[at, 1:]])
    run = recording(craft, times, eta, again)
    assert quality.repaired(run).usable() == pytest.approx(0.8 * craft.duration, rel=0.05)
    assert any("no commands" in line for line in findings.findings(described(run)))
    on_change = recording(
        craft, times, eta, rows[(rows[:, 0] < 0.4 * craft.duration) | (rows[:, 0] > 0.6 * craft.duration)]
    )
    assert not [s for s in quality.repaired(on_change).silent if craft.held > s[1] - s[0]]


def under_corrections(seed, swapped=False):
    """A boat whose poses are corrected once a second by far more than they scatter: the accelerations are
    noise, except over seconds. The commands are those of a seed."""
    craft = replace(CRAFT["boat with GNSS"], rate=10, noise=(0.003, 5e-4), duration=600)
    times, eta, _ = craft.recorded(1)
    corrections = np.random.default_rng(3).normal(size=(600, 3)) * [0.2, 0.2, 0.05]
    rows = craft.recorded(seed)[2][:, [0, 2, 1, 3] if swapped else slice(None)]
    return recording(craft, times, eta + np.repeat(corrections, 10, axis=0), rows)


def test_a_slow_craft_is_seen_to_follow_where_single_accelerations_are_noise():
    (line,) = (text for word, text in findings.facts(described(under_corrections(1))) if word == "reply")
    assert "too slowly" in line or "reacts" in line
    assert not suspicions.of(under_corrections(1))
    assert any("swapped" in str(one) for one in suspicions.of(under_corrections(1, swapped=True)))
    said = list(findings.grave(described(under_corrections(2))))
    assert not any("does not follow" in line for line in said), said


@pytest.mark.parametrize("heading", [0.5, 1.0])  # [rad]
def test_nobody_is_accused_where_noise_hides_the_motion(heading):
    craft = CRAFT["free-flyer"]
    times, eta, rows = craft.recorded()
    eta += np.random.default_rng(5).normal(0, [0.5, 0.5, heading], eta.shape)
    run = recording(craft, times, eta, rows)
    lines = list(findings.grave(described(run)))
    assert not any("does not follow" in line for line in lines)
    assert quality.repaired(run).reply or any("cannot be decided, because" in line for line in lines)


def test_noise_and_frame_rate_can_be_given(tmp_path):
    craft = CRAFT["free-flyer"]
    times, eta, rows = craft.recorded()
    run = recording(craft, times, eta, rows, noise=(1e-4, 1e-3))
    assert run.motion.noise == (1e-4, 1e-3)
    bag = tmp_path / "run.bag"
    ground.simulate(MODEL, seed=3, duration=5).save(bag)
    (read,) = ground.read(bag, noise=(2e-3, 2e-2), frame_rate=100)
    assert read.motion.noise == (2e-3, 2e-2) and read.frame_rate == 100
    told = identify("info", bag, "--noise", 0.002, 0.02)
    assert "noise 2.00 mm, 1.15 deg (as given)" in told.stdout
    fitted = identify("fit", bag, "--model", MODEL, "--window", 0.7, "-o", tmp_path / "m.yaml", "--details")
    assert "error over windows of 0.7 s" in fitted.stdout
