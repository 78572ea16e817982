"""Mistakes in units, axes, signs, clocks and swaps are named with their remedy; honest runs are not."""

import dataclasses
import re

import numpy as np
import pytest

import ground
import mistakes
from conftest import MODEL, ROOT, identify, slow, succeeds
from ground import _core
from ground.checks import findings, suspicions
from ground.checks.quality import repaired
from ground.simulation import experiments, gains

CASES = mistakes.MISTAKES + mistakes.OTHERS
NAMES = [case.name for case in CASES]


@pytest.mark.parametrize("number", range(len(NAMES)), ids=NAMES)
def test_a_mistake_is_named_with_its_remedy(number, tmp_path):
    name, named, said = mistakes.mistaken(number, tmp_path / "run", CASES)
    assert name == NAMES[number]
    assert named, said


@pytest.mark.parametrize("case", mistakes.HONEST, ids=lambda case: case.name)
def test_an_honest_run_is_not_suspected(case, tmp_path):
    _, lines, said = mistakes.honest(mistakes.HONEST.index(case), tmp_path / "run")
    assert lines == [] and "reply" in said


REMEDIES = {
    "swapped": ("left: {field: left}, right: {field: right}", "left: {field: right}, right: {field: left}"),
    "inverted": (
        "{field: left}, right: {field: right}",
        "{field: left, off: 1, full: 0}, right: {field: right, off: 1, full: 0}",
    ),
    "half a turn": ('axes: "x, z, -y"', 'axes: "x, z, -y"\n  heading_offset: 3.14'),
    "yaw": ("field: psi", "field: psi, sign: -1"),
    "mirror": ("[x, y]", '[x, "-y"]'),
    "millimetres": ("[px, py, pz]", "[px, py, pz], unit: mm"),
    "degrees": ("field: psi", "field: psi, unit: deg"),
    "percent": ("{field: left}", "{field: left, unit: percent}"),
    "axes": ('"x, z, -y"', '"x, -y, -z"'),
    "inches": ("[px, py, pz]", "[px, py, pz], unit: in"),
    "left-handed": ('"x, z, -y"', '"x, -z, y"'),
    "drift 1%": ("schema", "clock_drift: -0.00990099\nschema"),
    "newtons": ("{field: left}", "{field: left, full: 0.062}"),
    "-1..1": ("{field: left}", "{field: left, off: -1, full: 1}"),
}


@pytest.mark.parametrize("name", REMEDIES)
def test_the_remedy_mends_it(name, tmp_path):
    number = NAMES.index(name)
    run = mistakes.Recorded(number, **CASES[number].options)
    CASES[number].change(run)
    folder, mapping = run.write(tmp_path / "run")
    text = mapping.read_text()
    before, after = REMEDIES[name]
    assert before in text
    text = text.replace(before, after, 1)
    if name in ("percent", "newtons", "-1..1"):  # all channels alike
        text = re.sub(r"{field: (right|lift)}", after.replace("left", r"\1"), text)
    mapping.write_text(text)
    (found,) = ground.read(folder, mapping=mapping)
    assert suspicions.of(found) == []
    honest = mistakes.Recorded(number, **CASES[number].options)
    assert found.eta[:, :2] == pytest.approx(honest.eta[:, :2], abs=1e-9)
    assert np.diff(found.pose_times) == pytest.approx(np.diff(honest.times), abs=1e-6)
    assert found.controls == pytest.approx(honest.commands[:, 1:], abs=1e-9)


def test_fit_and_compare_say_it_and_change_nothing(tmp_path):
    run = mistakes.Recorded(3)
    mistakes.swapped(run)
    folder, mapping = run.write(tmp_path / "run")
    options = ("--mapping", mapping, "--model", MODEL)
    result = succeeds("fit", folder, *options, "-o", tmp_path / "fitted.yaml")
    assert result.stderr.count("left and right seem to be swapped") == 1
    assert "swap" in result.stdout.partition("Next:")[2].partition("parameter")[0]
    result = succeeds("compare", folder, *options, "--numbers", "-o", tmp_path / "compared")
    assert result.stderr.count("left and right seem to be swapped") == 1
    (found,) = ground.read(folder, mapping=mapping)
    assert np.array_equal(found.controls, run.commands[:, 1:])


def tracked(controller, seed, body, tau, delay, duration):
    """A run along a rhodonea by a controller that does not know of the craft's slow motors. body: ratios of
    its parameters to those that the controller knows; tau, delay: of the motors [s]."""
    believed, truth = _core.load_model(str(MODEL)), _core.load_model(str(MODEL))
    for name, ratio in zip(("I_z", "X_u", "Y_v", "N_r", "k"), body):
        truth.set_value(name, ratio * truth.value(name))
    for name, value in (("motor_lag.tau", tau), ("input_delay.delay", delay)):
        if value:
            truth.add_effect(name.split(".")[0])
            truth.set_value(name, value)
    place = _core.load_room(str(ROOT / "cfg" / "room" / "room_4x4.yaml"))
    params, mocap = _core.TrackingParams(), _core.MocapParams()
    params.controller = gains.choice(controller)
    params.reference.kind, params.reference.size = "rhodonea", 1.0
    params.reference.x, params.reference.y = place.home
    params.duration, params.room, mocap.latency = duration, place, 0.02
    push = experiments.disturbance_in_shares(truth, 0.005, 0.5)
    return experiments.simulate(
        truth, params, "tracked", [*place.home, 0.0], mocap=mocap, seed=seed, believed=believed,
        disturbance=push,
    )  # fmt: skip


def kinds(run, times=None):
    """Kinds of the suspicions of a run, or of that run with other times of its poses (n,) [s]."""
    run = run if times is None else dataclasses.replace(run, pose_times=times)
    return [found.kind for found in suspicions.of(run) if found.misread]


@pytest.mark.parametrize("seed", [1, 2, 4])
def test_a_slow_craft_under_control_is_not_another_clock(seed):
    run = tracked("TrajectoryTracking", seed, (1.27, 1.01, 1.29, 0.75, 1.06), 0.09, 0.08, 30.0)
    assert run.stopped  # it oscillates, so that commands and motion are alike at many lags
    assert kinds(run) == []


def test_another_clock_shows_under_control_too():
    for seed in (1, 2, 3):
        run = tracked("ModelPredictive", seed, (1.1, 0.9, 1.1, 0.9, 1.0), 0.05, 0.0, 30.0)
        since = run.pose_times - run.pose_times[0]
        assert kinds(run) == []
        assert kinds(run, run.pose_times + 0.01 * since) == ["drift"]
    assert kinds(run, run.pose_times + 0.8) == kinds(run, run.pose_times - 0.2) == ["clock"]


@pytest.mark.parametrize("seed", [2, 3, 4])
@pytest.mark.parametrize("lag", [0.0, 0.05, 0.1])
def test_part_of_a_flight_under_control_is_not_misread(seed, lag):
    """Without the take-off: the controller's answers to what the mocap sees are as large as its commands."""
    model = ground.Model.load(MODEL)
    slower = model.with_effect("motor_lag", tau=lag) if lag else model
    run = ground.simulate(slower, "tracking", controller="ModelPredictive", seed=seed, duration=23)
    poses, commands = (times > run.pose_times[0] + 8 for times in (run.pose_times, run.control_times))
    part = dataclasses.replace(
        run,
        pose_times=run.pose_times[poses],
        eta=run.eta[poses],
        control_times=run.control_times[commands],
        controls=run.controls[commands],
    )
    assert suspicions.about([part], model.core) == []
    late = dataclasses.replace(part, control_times=part.control_times + 0.15)
    assert "clock" in kinds(late)


def test_the_delay_of_a_boat_may_be_its_own(tmp_path):
    boat = ground.Model.load(ROOT / "cfg" / "craft" / "twin_screw_catamaran.yaml")
    boat.with_effect("input_delay", delay=0.6).save(tmp_path / "late.yaml")
    drive = ["--input", "multilevel-prbs", "--clock", "0.7", "--duration", "120", "--rate", "20"]
    identify(
        "simulate", "--model", tmp_path / "late.yaml", *drive, "--position-noise", "0.005",
        "-o", tmp_path / "boat.bag",
    )  # fmt: skip
    [run] = ground.read(tmp_path / "boat.bag")
    assert kinds(run) == []
    assert kinds(run, run.pose_times + 3) == ["clock"]


def driven(seed, rate=100.0, duration=20.0):
    """A run of random commands that may change every 80 ms: times, poses, time and command of each change."""
    random, times = np.random.default_rng(seed), np.arange(0, duration, 1 / rate)
    edges = np.arange(0, duration, 0.08)
    sent = np.column_stack([edges, random.choice([0.0, 0.5], (len(edges), 2)), np.ones(len(edges))])
    run = _core.simulate(_core.load_model(str(MODEL)), sent, times, np.zeros(3), np.zeros(3))
    eta = run["eta"] + random.normal(0, [3e-4, 3e-4, 3e-3], (len(times), 3))
    changes = np.append(True, (np.diff(sent[:, 1:], axis=0) != 0).any(axis=1))
    return times, eta, sent[changes], random


def described(times, eta, sent):
    """What info holds of a run with other commands, and what it says of how the craft replies."""
    sent = sent[np.argsort(sent[:, 0])]
    run = ground.Recording.from_arrays(times, eta, sent[:, 1:], sent[:, 0])
    (found,) = findings.describe([repaired(run)])
    return found, dict(findings.facts(found)).get("reply", ""), list(findings.grave(found))


def sampled(sent, random, period):
    """The commands that hold at every period [s]."""
    times = np.arange(0, sent[-1, 0], period)
    return np.column_stack([times, sent[np.searchsorted(sent[:, 0], times, side="right") - 1, 1:]])


THINNED = {
    "every 0.15 s": lambda sent, random: sampled(sent, random, 0.15),
    "every 0.25 s": lambda sent, random: sampled(sent, random, 0.25),
    "every second": lambda sent, random: sent[::2],
    "half lost": lambda sent, random: sent[random.random(len(sent)) > 0.5],
}


@pytest.mark.parametrize("way", THINNED)
def test_commands_that_were_not_recorded_are_missed(way):
    seed = list(THINNED).index(way) % 3
    times, eta, sent, random = driven(seed, rate=[100.0, 50.0, 120.0][seed])
    _, reply, said = described(times, eta, THINNED[way](sent, random))
    assert "commands between the recorded ones are missing" in " ".join(said)
    assert "reacts -" not in reply


@pytest.mark.parametrize("late", [(0.03, 0.03), (0.005, 0.08), (0.02, 0.1), (0.09, 0.09)])
def test_commands_with_late_stamps_are_named_with_the_key_that_mends_them(late):
    times, eta, sent, random = driven(2)
    stamps = sent[:, 0] + random.uniform(*late, len(sent))
    found, reply, said = described(times, eta, np.column_stack([stamps, sent[:, 1:]]))
    (clock,) = [one for one in found["suspicions"] if one["kind"] == "clock"]
    offset = float(re.search(r"clock_offset: (\S+)", clock["remedy"]).group(1))
    assert offset == pytest.approx(np.mean(late), abs=0.015)
    assert "before its command" in reply and said
    _, reply, said = described(times + offset, eta, np.column_stack([stamps, sent[:, 1:]]))
    assert "before its command" not in reply + " ".join(said)


@pytest.mark.parametrize("seed", range(3))
def test_whole_commands_are_neither_missed_nor_early(seed):
    times, eta, sent, random = driven(seed, rate=[100.0, 50.0, 30.0][seed % 3], duration=8.0 + 2 * seed)
    again = sampled(sent, random, 0.02)  # as a publisher with a rate sends them
    for commands in (sent, again):
        _, reply, said = described(times, eta, commands)
        assert said == [] and "reacts" in reply and "-" not in reply


@slow
def test_the_real_runs_of_a_turned_mocap_are_suspected_and_the_others_are_not(real_bags):
    for stamp, bag in real_bags.items():
        (run,) = ground.read(bag)
        kinds = [s.kind for s in suspicions.of(run)]
        assert kinds == (["offset"] if stamp.startswith("2019-04-11") else []), stamp
