"""The motion shows which channel drives which thruster, with which sign and heading."""

import math

import numpy as np
import pytest

import ground
import mistakes
from conftest import MODEL, ROOT, SHARED, json_of, mapping_as_logged, succeeds
from ground import _core
from ground.checks import layouts, suspicions
from ground.reading.recording import checked
from ground.support.errors import GroundError

RAW = SHARED.parent / "epfl_2019_12"
FOUR_YAML = """
schema: ground/model/1
name: "Four"
body:
  {m: 0.176, I_z: 4.0e-4, X_u: 0.02, Y_v: 0.05, N_r: 2.0e-4, k: 0.1, thrusters: [
    {name: back_left, position: [-0.05, -0.0425], direction: 0},
    {name: back_right, position: [-0.05, 0.0425], direction: 0},
    {name: front_left, position: [0.05, -0.0425], direction: 180},
    {name: front_right, position: [0.05, 0.0425], direction: 180}]}
effects: []
"""
FOUR_MODEL = _core.parse_model(FOUR_YAML, "four.yaml")
FOUR = layouts.thrusters_of(FOUR_MODEL)
NAMES = [thruster.name for thruster in FOUR]


def flown(seed, model=FOUR_MODEL, duration=30.0, change=None, together=False):
    """A recording of a simulated craft with four thrusters; change: of poses and commands by name."""
    random = np.random.default_rng(seed)
    edges = np.arange(0, duration, 0.1)
    commands = random.choice([0.0, 0.6], (len(edges), 4))
    if together:
        commands[:, 1] = commands[:, 0]
    inputs = np.column_stack([edges, commands, np.ones(len(edges))])
    times = np.arange(0, duration, 0.02)
    eta = _core.simulate(model, inputs, times, np.zeros(3), np.zeros(3))["eta"]
    eta = eta + random.normal(0, [2e-4, 2e-4, 3e-3], eta.shape)
    channels = dict(zip(NAMES, commands.T), lift=np.ones(len(edges)))
    if change:
        eta, channels = change(eta, channels)
    eta = eta * 1.0
    eta[:, 2] = np.angle(np.exp(1j * eta[:, 2]))
    rows = np.column_stack([1000 + edges, *channels.values()])
    return checked(
        "run%d.bag" % seed, np.column_stack([1000 + times, eta]), rows, "a test", [], list(channels)
    )


def exchanged(*pairs):
    def change(eta, channels):
        found = dict(channels)
        for a, b in pairs:
            found[a], found[b] = channels[b], channels[a]
        return eta, found

    return change


@pytest.mark.parametrize(
    "pairs",
    [
        [("back_left", "back_right")],
        [("back_left", "front_left"), ("back_right", "front_right")],
        [("back_left", "front_right")],
    ],
)
def test_exchanged_channels_of_four_thrusters_are_found(pairs):
    verdict = layouts.judge([flown(1, change=exchanged(*pairs))], FOUR)
    expected = exchanged(*pairs)(None, {name: name for name in NAMES})[1]
    found = [verdict.best.hypothesis, *verdict.same]
    assert tuple(expected.values()) in [h.channels for h in found if h.heading_offset == 0]
    assert not verdict.is_as_recorded and verdict.undecided == []


def test_an_inverted_and_a_dead_thruster_of_four_are_found():
    def inverted(eta, channels):
        return eta, dict(channels, front_left=0.6 - channels["front_left"])

    def dead(eta, channels):
        return eta, dict(channels, front_left=np.random.default_rng(0).choice([0, 0.6], len(eta) // 5))

    for change, sign, kind in ((inverted, -1, "invert"), (dead, 0, "dead")):
        recording = flown(2, change=change)
        verdict = layouts.judge([recording], FOUR)
        assert verdict.best.hypothesis.channels == tuple(NAMES)
        assert verdict.best.hypothesis.signs == (1, 1, sign, 1)
        (finding,) = suspicions.about([recording], FOUR_MODEL)
        assert finding.kind == kind and "front_left" in finding.remedy


def test_runs_with_and_without_the_mistake_are_told_from_each_other():
    runs = [flown(1), flown(2, change=exchanged(("back_left", "back_right")))]
    (finding,) = suspicions.about(runs, FOUR_MODEL)
    assert finding.runs == ("run2",) and finding.kind == "swap"
    assert "back_left and back_right seem to be swapped" in finding.sentence


def test_what_the_commands_cannot_show_is_said():
    verdict = layouts.judge([flown(3, together=True)], FOUR)
    assert verdict.is_as_recorded and verdict.undecided
    assert "back_right and back_left always change together (correlation 1.00)" in verdict.why
    assert "it cannot be decided whether " in layouts.sentence(verdict)
    idle = layouts.judge([flown(3, change=lambda eta, c: (eta, dict(c, front_left=0 * c["lift"])))], FOUR)
    assert idle.why == "front_left hardly changes"


def test_commands_that_explain_no_force_do_not_support_the_channels():
    other = flown(4).eta[:, :2]
    verdict = layouts.judge([flown(1, change=lambda eta, c: (np.column_stack([other, eta[:, 2]]), c))], FOUR)
    assert verdict.best.force < 0.02 and verdict.best.turn > 0.5
    assert not layouts.sentence(verdict).startswith(layouts.AS_RECORDED)
    assert "undecided" in layouts.sentence(verdict)
    assert verdict.is_open and not layouts.judge([flown(1)], FOUR).is_open


def test_channels_that_the_motion_supports_are_as_recorded():
    for run in (flown(1), flown(3, together=True)):
        assert layouts.sentence(layouts.judge([run], FOUR)).startswith(layouts.AS_RECORDED)


def test_info_says_which_channel_drives_which_thruster(tmp_path):
    run = mistakes.Recorded(5)
    mistakes.swapped(run)
    path, mapping = run.write(tmp_path / "run")
    options = (path, "--mapping", mapping, "--model", MODEL)
    result = succeeds("info", *options)
    assert "\nleft and right seem to be swapped: the commands" in result.stdout
    (described,) = json_of("info", *options)
    assert described["layout"]["best"]["hypothesis"]["channels"] == ["right", "left"]


def test_a_channel_that_is_missing_is_named(tmp_path):
    path, mapping = mistakes.Recorded(5).write(tmp_path / "run")
    with pytest.raises(GroundError, match="no command is named back_left or"):
        layouts.judge(ground.read(path, mapping=mapping), FOUR)


@pytest.mark.filterwarnings("ignore::ground.support.errors.RecordingWarning")
def test_the_second_craft_is_read_and_what_cannot_be_told_is_said(tmp_path):
    """Its log says back for front, or the other ways that are the same to any motion. The bench decides:
    back thrusters push forward."""
    if not RAW.is_dir():
        pytest.skip("the real recordings of December 2019 are not beside the workspace")
    recordings = ground.read(RAW, mapping=mapping_as_logged(tmp_path))
    verdict = layouts.judge(recordings, FOUR)
    ways = {
        (h.channels, h.heading_offset, h.mirrored)
        for h in (verdict.best.hypothesis, *verdict.same)
        if set(h.signs) == {1}
    }
    assert ways == {
        (("front_left", "front_right", "back_left", "back_right"), 0.0, False),
        (("back_right", "back_left", "front_right", "front_left"), math.pi, False),
        (("back_left", "back_right", "front_left", "front_right"), math.pi, True),
    }
    assert [h.signs for h in verdict.same].count((-1, -1, -1, -1)) == 1  # or all push the other way
    assert verdict.undecided == [] and verdict.recorded.ratio95[0] > 1.05
    assert verdict.best.force > 0.2 and verdict.best.turn > 0.08
    for recording in recordings:  # a single run does not contradict, and may leave it open
        alone = layouts.judge([recording], FOUR)
        open_still = [alone.best, *alone.undecided]
        assert verdict.best.hypothesis in [found.hypothesis for found in open_still]


@pytest.mark.parametrize("dead", [None, "valve_3"])
def test_a_valve_that_stays_shut_in_a_run_stands_out_by_the_turns(dead):
    """Although the measured point is off the centre of mass, so that turns look like forces."""
    model = _core.load_model(str(ROOT / "cfg" / "craft" / "free_flyer.yaml"))
    truth = model.copy()
    truth.add_effect("marker_offset")
    truth.set_value("marker_offset.dx", 0.05)
    names = [thruster["channel"] for thruster in model.thrusters]
    random = np.random.default_rng(3)
    edges, times = np.arange(0, 60, 0.7), np.arange(0, 60, 0.02)
    commands = random.choice([0.0, 1.0], (len(edges), len(names)), p=[0.7, 0.3])
    acting = commands * [name != dead for name in names]
    inputs = np.column_stack([edges, acting, np.ones(len(edges))])
    eta = _core.simulate(truth, inputs, times, np.zeros(3), np.zeros(3))["eta"]
    eta = eta + random.normal(0, [2e-5, 2e-5, 1e-4], eta.shape)
    eta[:, 2] = np.angle(np.exp(1j * eta[:, 2]))
    rows = np.column_stack([1000 + edges, commands])
    run = checked("run.bag", np.column_stack([1000 + times, eta]), rows, "a test", [], names)
    findings = suspicions.about([run], model)
    assert len(findings) == (dead is not None)
    if dead:
        assert findings[0].kind in ("dead", "weak") and dead in findings[0].evidence
