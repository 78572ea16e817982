"""Verdicts on whether a craft stops by itself, on synthetic trials, and the file of outcomes."""

import dataclasses
import re
import threading

import numpy as np
import pytest
import yaml

from ground.nodes import own_stop
from ground.nodes import own_stop_records as records
from ground.support.errors import GroundError

# Acceleration by thrust, and decelerations by floor and air [m/s^2].
THRUST, FLOOR, GLIDE = 0.32, 2.0, 0.06
SILENCE = 1.5  # [s]


def trial(
    watchdog, seed=1, speed=0.37, thrust=THRUST, floor=FLOOR, noise=0.004, glides=False, silence=SILENCE
):
    """Trial of a driven craft that gets no commands from 0 s on. It stops its motors after `watchdog` [s]
    or never (None); with `glides` its lift stays on. The noise is coloured like an estimator's."""
    random = np.random.default_rng(seed)
    times = np.arange(-1.0, silence + 1.5, 0.01)
    off = np.inf if watchdog is None else watchdog
    speeds, now = [], speed - 1.0 * thrust
    for t in times:
        zeros = t >= silence
        if zeros or (t >= off and not glides):
            a = -floor
        else:
            a = -GLIDE if t >= off else thrust
        a = a if now > 0 or a > 0 else 0.0
        speeds.append(now)
        now = max(0.0, now + 0.01 * a)
    white = random.normal(0, noise, len(times))
    kernel = np.exp(-np.arange(10) / 3.0)
    colored = np.convolve(white, kernel / np.sqrt(np.sum(kernel**2)))[: len(times)]
    measured = np.abs(np.array(speeds) + colored)
    return own_stop.StopTrial(times, measured, np.ones(len(times), bool), 0.0, silence)


@pytest.mark.parametrize("watchdog, noise", [(0.05, 0.015), (0.25, 0.004), (1.0, 0.015)])
def test_a_craft_with_a_watchdog_passes_with_its_time(watchdog, noise):
    inside = 0
    for seed in range(20):
        verdict = own_stop.judge(trial(watchdog, seed, noise=noise))
        assert verdict.outcome == own_stop.PASSED, verdict
        assert verdict.braking == pytest.approx(FLOOR, rel=0.3)
        assert verdict.uncertainty < 0.12
        inside += abs(verdict.stopped_after - watchdog) < verdict.uncertainty
    assert inside >= 18, "at least 18 of 20 for intervals of 95%"


@pytest.mark.parametrize("glides", [False, True])
def test_a_craft_without_a_watchdog_fails(glides):
    for seed in range(20):
        verdict = own_stop.judge(trial(0.4 if glides else None, seed, glides=glides))
        assert verdict.outcome == own_stop.FAILED, verdict
        assert ("gliding" if glides else "driven on by its thrust") in verdict.reason
        assert verdict.stopped_after is None


def changed(given, **values):
    return dataclasses.replace(given, **values)


def lost(given, begin, end):
    valid = given.valid & ~((given.times > begin) & (given.times < end))
    return changed(given, valid=valid)


def gap(given, begin, end):
    kept = ~((given.times > begin) & (given.times < end))
    return changed(given, times=given.times[kept], speeds=given.speeds[kept], valid=given.valid[kept])


UNDECIDED = [
    ("slow", lambda: trial(0.2, speed=0.1, thrust=0.05), "more thrust"),
    ("lost", lambda: lost(trial(None), 0.5, 0.6), "the state was lost 0.5. s after"),
    ("gap", lambda: gap(trial(0.2), 0.15, 0.4), "no state for 0.2. s, from 0.1. s"),
    ("short", lambda: changed(trial(0.2), silence_end=0.3), "0.30 s"),
    ("wall", lambda: trial(0.5, floor=15.0), "hit something"),
    ("held", lambda: trial(-0.2, speed=0.8), "before the silence began"),
    ("at the end", lambda: trial(1.45), "when the silence ended"),
    ("nan", lambda: changed(trial(0.2), speeds=np.where(np.arange(400) == 120, np.nan, 0.4)), "not finite"),
]


@pytest.mark.parametrize("make, reason", [row[1:] for row in UNDECIDED], ids=[r[0] for r in UNDECIDED])
def test_an_undecided_trial_gives_a_reason(make, reason):
    verdict = own_stop.judge(make())
    assert verdict.outcome == own_stop.UNDECIDED, verdict
    assert re.search(reason, verdict.reason), verdict.reason


def test_records_are_added_and_none_is_lost(tmp_path, monkeypatch):
    monkeypatch.setenv("ROS_HOME", str(tmp_path))
    path = records.default_path()
    assert path == str(tmp_path / "ground" / "own_stop.yaml")
    assert records.read(path) == {}
    threads = [
        threading.Thread(target=records.append, args=(path, "craft %d" % (i % 3), {"date": str(i)}))
        for i in range(12)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    crafts = yaml.safe_load(open(path))
    assert set(crafts) == {"craft 0", "craft 1", "craft 2"}
    assert sorted(int(t["date"]) for c in crafts.values() for t in c) == list(range(12))
    records.append(path, "craft 0", {"date": "99"})
    now = records.read(path)
    assert now["craft 0"][:-1] == crafts["craft 0"] and now["craft 0"][-1] == {"date": "99"}


@pytest.mark.parametrize("text", ["a: [", "- 1\n", "a: 3\n"])
def test_a_file_of_another_kind_is_not_changed(tmp_path, text):
    path = tmp_path / "own_stop.yaml"
    path.write_text(text)
    with pytest.raises(GroundError):
        records.append(str(path), "craft", {})
    assert path.read_text() == text
