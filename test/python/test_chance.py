"""The remaining error is called a random disturbance only where nothing speaks against it: not where it has a
frequency of its own, and for certain only where the same commands were given twice."""

import numpy as np
import pytest

import ground
from conftest import MODEL

PUSH, WEAK = (0.04, 0.5), (0.01, 0.5)  # share of full thrust, time [s]


def commands(seed):
    """Twelve seconds of random levels: rows of time [s], left, right."""
    levels = np.random.default_rng(seed).uniform(0, 1, (24, 2))
    return np.vstack([np.column_stack([0.5 * np.arange(24), levels]), [12.0, 0.0, 0.0]])


def flown(true, number, seed, push=PUSH):
    """A run of the commands `number`; seed: of pushes and noise."""
    given = dict(inputs=commands(number), seed=seed, disturbance=push, name="run%d" % seed)
    return ground.simulate(true, **given)


@pytest.fixture(scope="module")
def given():
    return ground.Model.load(MODEL)


def said(found):
    return " ".join(text for _, text in found.headline())


def test_a_push_is_called_random_once_the_same_commands_were_given_twice(given):
    once = ground.diagnose(given, [flown(given, number, number) for number in (1, 2, 3)])
    twice = ground.diagnose(given, [flown(given, *pair) for pair in ((1, 1), (1, 2), (1, 4), (2, 3))])
    assert once.verdict == twice.verdict == "complete"
    assert "the same commands twice" in said(once) and "unrecorded" in said(once)
    assert "nothing needed" in said(twice) and "unrecorded" not in said(twice)
    assert once.report["agreement"]["common"] is None
    common = twice.report["agreement"]["common"]
    assert common["pairs"] == 3 and common["low"] < 0 < common["high"] < 0.5


@pytest.mark.parametrize("rate", [0.4, 2.0])
@pytest.mark.parametrize("frame", ["body", "world"])
def test_what_swings_is_said_with_its_frequency_and_not_called_chance(given, rate, frame):
    """A fan that swings, an unbalanced motor: each run begins at another phase."""
    runs = []
    for seed in (1, 2, 3):
        wave = "a*sin(2*pi*%g*t + %g)" % (rate, 2.1 * seed)
        hum = ground.Effect("hum", X=wave, Y="0.5*" + wave, frame=frame, a=(0.008, "N"))
        runs.append(flown(given + hum, seed, seed, WEAK))
    found = ground.diagnose(given, runs)
    assert found.verdict == "undecided" and not found.effects
    assert found.report["agreement"]["frequency"] == pytest.approx(rate, rel=0.15)
    assert "Hz" in said(found) and "nothing needed" not in said(found)


def test_what_comes_back_with_the_same_commands_is_no_chance(given):
    """The library's lag was not among the effects that were tried."""
    true = given + ground.Effect("motor_lag", tau=0.15)
    found = ground.diagnose(given, [flown(true, *pair) for pair in ((1, 1), (1, 2), (2, 3))], only=["wind"])
    common = found.report["agreement"]["common"]
    assert common["low"] > 0.2 or found.proposal is not None
    assert "is a random disturbance" not in said(found)
