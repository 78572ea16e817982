"""Recordings that are odd or useless: every verb gives a result, or says in a sentence why not."""

import numpy as np
import pytest

import ground
from conftest import MODEL, recording_of, simulate_run
from ground import _core
from ground.checks import findings, quality, suspicions
from test_hulls import boat, recorded

MOMENT = 2e-5  # constant yaw moment of the craft, which its model does not have [N m]


def flown(rate=50.0, noise=(3e-4, 3e-4, 3e-3), seconds=12.0):
    """Stamps, poses, stamps of commands and commands of a craft that a moment turns; and random numbers."""
    random = np.random.default_rng(5)
    at = np.arange(0, seconds, 0.25)
    commands = np.column_stack([random.integers(0, 2, (len(at), 2)) * 0.6, np.ones(len(at))])
    times = np.arange(0.05, seconds, 1 / rate)
    craft = ground.Model.load(MODEL).with_effect("yaw_bias", n0=MOMENT).core
    eta = _core.simulate(craft, np.column_stack([at, commands]), times, np.zeros(3), np.zeros(3))["eta"]
    return times, eta + random.normal(size=eta.shape) * noise, at, commands, random


def twice(times, eta, later=0.0, off=(0.0, 0.0, 0.0), random=None):
    """Each pose twice, the second time some seconds later and off by random errors."""
    times, eta = np.repeat(times, 2), np.repeat(eta, 2, axis=0)
    times[1::2] += later
    if random:
        eta[1::2] += random.normal(size=eta[1::2].shape) * off
    return times, eta


NOISE = (3e-4, 3e-4, 3e-3)
ODD = {
    "twice": lambda t, p, at, c, _: (*twice(t, p, 0.01), at, c),
    "twice at once": lambda t, p, at, c, _: (*twice(t, p), at, c),
    "two cameras, nearly at once": lambda t, p, at, c, r: (*twice(t, p, 2e-6, NOISE, r), at, c),
    "constant pose": lambda t, p, at, c, _: (t, 0 * p + 1, at, c),
    "constant place": lambda t, p, at, c, _: (t, p * [0, 0, 1], at, c),
    "whole centimetres": lambda t, p, at, c, _: (t, np.round(p, 2), at, c),
    "two poses": lambda t, p, at, c, _: (t[:2], p[:2], at, c),
    "gaps": lambda t, p, at, c, _: (t[t % 3 < 2], p[t % 3 < 2], at, c),
    "bursts": lambda t, p, at, c, _: (np.floor(10 * t) / 10 + 1e-5 * (np.arange(len(t)) % 5), p, at, c),
    "two commands": lambda t, p, at, c, _: (t, p, at[[0, 20]], c[[0, 20]]),
    "no thrust": lambda t, p, at, c, _: (t, p, at, c * [0, 0, 1]),
    "nothing on": lambda t, p, at, c, _: (t, p, at, 0 * c),
    "commands after the poses": lambda t, p, at, c, _: (t, p, at + 11.8, c),
    "far away": lambda t, p, at, c, _: (t, p + [1e7, 1e7, 0], at, c),
    "stamps in nanoseconds": lambda t, p, at, c, _: (1.7e18 + t, p, 1.7e18 + at, c),
}


def said_or_found(work, *given, **options):
    """The result of work, or the sentence that refuses it."""
    try:
        return work(*given, **options)
    except ground.GroundError as refusal:
        assert str(refusal) and "\n" not in str(refusal)
        return str(refusal)


def looked_at(run):
    """What info prints of a run."""
    doubts = suspicions.about([run], ground.Model.load(MODEL).core)
    return [list(findings.findings(d)) for d in findings.describe([quality.repaired(run)], doubts)]


@pytest.mark.parametrize("odd", list(ODD))
@pytest.mark.filterwarnings("ignore::ground.GroundWarning", "error::RuntimeWarning")
def test_every_verb_gives_a_result_or_a_sentence(odd):
    times, eta, at, commands = ODD[odd](*flown())
    run = said_or_found(ground.Recording.from_arrays, times, eta, commands, at)
    if isinstance(run, str):
        return
    said_or_found(looked_at, run)
    for verb in (ground.fit, ground.compare, ground.predict):
        found = said_or_found(verb, MODEL, run)
        assert isinstance(found, str) or list(found.lines())
    found = said_or_found(ground.diagnose, MODEL, run, only=["yaw_bias"])
    if "at once" in odd and "commands" not in odd:  # nothing is wrong with the motion
        assert found.effects == ("yaw_bias",)


def test_a_command_that_changes_once_at_the_end_of_a_short_run_is_no_error():
    times, eta, inputs = simulate_run(duration=3.0)
    times, eta, inputs = times[100:190], eta[100:190], inputs[14:29]
    inputs[1:, 1:] = inputs[0, 1:]
    inputs[-1, 1] += 0.5
    assert isinstance(looked_at(recording_of(times, eta, inputs)), list)


def test_a_slow_craft_is_diagnosed_whose_poses_come_twice_at_once():
    run = recorded(boat(), 3, seconds=60)
    random = np.random.default_rng(4)
    chosen = np.arange(len(run.eta))[::2]  # 10 Hz
    again = np.sort(np.concatenate([chosen, chosen[random.random(len(chosen)) < 0.4]]))
    times = run.pose_times + random.uniform(-0.02, 0.02, len(run.eta))
    eta = run.eta[again] + random.normal(size=(len(again), 3)) * 2e-3
    odd = ground.Recording.from_arrays(
        times[again], eta, run.controls, run.control_times, channels=run.channels
    )
    assert (np.diff(odd.motion.times) == 0).any()
    found = ground.diagnose(boat(), odd, only=["hull_lift"])
    assert found.effects == () and np.isfinite(found.error[0])
    assert list(ground.compare(boat(), odd).lines())
