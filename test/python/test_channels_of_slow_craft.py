"""Channels of a slow craft are judged over all its runs, by what they do while damping acts."""

import numpy as np
import pytest

import ground
from conftest import MODEL
from ground import _core
from ground.recordings import findings, quality, suspicions
from ground.recordings.recording import Recording

RUNS, DURATION, RATE = 6, 80.0, 10.0  # short runs of a table with 10 rows a second; fixes come at 5 Hz
CATAMARAN = MODEL.parent.parent / "craft" / "twin_screw_catamaran.yaml"
BOAT = dict(m=15.0, l=0.285, I_z=8.0, X_u=10.0, Y_v=40.0, N_r=8.0, k=25.0)


def boat():
    model = ground.Model.load(MODEL).core
    for name, value in BOAT.items():
        model.set_value(name, value)
    return model


def sailed(seed, swapped=False, fixes=True):
    """A run by hand with few commands. Corrections of the positions once a second hide what a command does at
    once."""
    random = np.random.default_rng(seed)
    edges = np.append(0, np.sort(random.uniform(5, DURATION, 7)))
    rows = np.column_stack([edges, random.uniform(0, 1, (len(edges), 2)), np.ones(len(edges))])
    rows[0, 1:3] = 0
    times = np.arange(int(DURATION * RATE)) / RATE
    eta = _core.simulate(boat(), rows, times, np.zeros(3), np.zeros(3))["eta"]
    seconds = random.normal(size=(int(DURATION), 3)) * [0.1, 0.1, 0.05]
    eta = eta + np.repeat(seconds, int(RATE), axis=0) + random.normal(size=eta.shape) * [5e-3, 5e-3, 5e-4]
    sent = np.arange(0, DURATION, 0.1)
    held = rows[np.searchsorted(edges, sent, side="right") - 1, 1:]
    held = held[:, [1, 0, 2]] if swapped else held
    return Recording("run%d" % seed, times, eta, sent, held, "made up")


def misread(runs, model=None):
    return [one for one in suspicions.about(runs, model) if one.misread]


CRUDE = {"m": 1.3, "I_z": 1.5, "k": 1.5, "Y_v": 0.6}  # a model's values over the true ones


def crude(model):
    for name, factor in CRUDE.items():
        model.set_value(name, factor * model.value(name))
    return model


def test_runs_that_do_not_decide_alone_decide_together():
    swapped = [sailed(seed, swapped=True) for seed in range(RUNS)]
    assert sum(bool(misread([run])) for run in swapped) < RUNS
    (finding,) = misread(swapped)
    assert finding.kind == "swap" and finding.runs == tuple(run.name for run in swapped)
    assert finding.sentence.startswith(
        "run0, run1, run2, run3, run4, run5: left and right seem to be swapped"
    )
    assert [one.kind for one in misread(swapped, crude(boat()))] == ["swap"]
    assert not misread([sailed(seed) for seed in range(RUNS)])


def turning(seed, channels=("port", "starboard", "lift"), duration=200.0):
    """A catamaran at constant thrust in all, which is turned by the difference of its propellers alone."""
    random = np.random.default_rng(seed)
    edges = np.arange(0, duration, 5.0)
    port = 0.5 + 0.1 * random.normal(size=len(edges))
    commands = np.column_stack([port, 1 - port, 0 * port])
    times = np.arange(0.1, duration, 1 / RATE)
    rows = np.column_stack([edges, commands])
    eta = _core.simulate(ground.Model.load(CATAMARAN).core, rows, times, np.zeros(3), np.zeros(3))["eta"]
    poses = eta + random.normal(size=eta.shape) * [0.02, 0.02, 0.01]
    return Recording.from_arrays(times, poses, commands, edges, channels=channels, name="run%d" % seed)


@pytest.mark.parametrize("has_model", [True, False])
def test_a_boat_that_only_turns_is_not_accused(has_model):
    """Its sway looks as if one propeller pushed it sideways: so does that of any model of a boat."""
    model = crude(ground.Model.load(CATAMARAN).core) if has_model else None
    channels = ("port" if has_model else "left", "starboard" if has_model else "right", "lift")
    accused = [seed for seed in range(6) if misread([turning(seed, channels)], model)]
    assert len(accused) <= 1, accused


def test_commands_that_always_cancel_are_judged():
    """The sum of both is the same to the last digit, so that nothing is said of what it does."""
    for seed in range(8):
        assert suspicions.alone(turning(seed, ("left", "right", "lift"), 60.0), suspicions.PAIR) is not None


def test_one_run_of_another_wiring_is_told_apart():
    runs = [sailed(seed) for seed in range(RUNS - 1)] + [sailed(RUNS, swapped=True)]
    assert all(one.runs == ("run%d" % RUNS,) for one in misread(runs))


def gusts(seed, duration):
    """A boat that a controller keeps from turning, by its yaw rate, against gusts: its commands answer the
    motion."""
    random = np.random.default_rng(seed)
    step = 1 / RATE
    count = int(duration * RATE)
    pose, speed, gust, rows, poses = np.zeros(3), np.array([0.5, 0.0]), np.zeros(2), [], []
    for _ in range(count):
        poses.append(pose.copy())
        steer, push = np.clip(-1.5 * speed[1], -0.5, 0.5), np.clip(0.5 - 1.5 * (speed[0] - 0.5), 0.2, 0.8)
        rows.append(np.clip([push + steer, push - steer, 1.0], 0, 1))
        gust += -gust * step / 10 + random.normal(size=2) * np.sqrt(step) * [3.0, 1.0]
        force = BOAT["k"] * (rows[-1][0] + rows[-1][1]) - BOAT["X_u"] * speed[0] + gust[0] - 15
        moment = BOAT["k"] * BOAT["l"] * (rows[-1][0] - rows[-1][1]) - BOAT["N_r"] * speed[1] + gust[1]
        speed = speed + step * np.array([force / BOAT["m"], moment / BOAT["I_z"]])
        pose = pose + step * np.array([speed[0] * np.cos(pose[2]), speed[0] * np.sin(pose[2]), speed[1]])
    times = np.arange(count) * step
    eta = np.array(poses) + random.normal(size=(count, 3)) * [0.05, 0.05, 0.01]
    return Recording("run%d" % seed, times, eta, times, np.array(rows), "made up")


@pytest.mark.parametrize("seed", range(2))
def test_a_controller_that_answers_gusts_accuses_nobody(seed):
    assert not misread([gusts(10 * seed + one, 200.0) for one in range(3)])


def test_positions_are_recognised_as_held_although_the_boat_rests_half_of_the_time():
    run = sailed(1)
    eta = np.round(run.eta / [0.01, 0.01, 1e-5]) * [0.01, 0.01, 1e-5]
    still = np.arange(len(eta)) < 0.6 * len(eta)
    eta[still, :2] = eta[0, :2] + 0.01 * np.random.default_rng(1).integers(0, 2, (int(still.sum()), 2))
    eta[1::2, :2] = eta[::2, :2]
    table = Recording("run", run.pose_times, eta, run.control_times, run.controls, "made up")
    assert findings.described(quality.repaired(table))["poses"]["held"] > 0.45 * len(eta)
