"""Stamps and commands changed by damage to a file are noticed; merely irregular ones are not."""
import struct

import numpy as np
import pytest
from conftest import simulate_run, write_bag

import genpy
from ground.recordings import plausibility, recording
from ground.recordings.recording import CHANNELS

TIMES = 1000 + np.arange(0, 7, 1 / 15)


@pytest.mark.parametrize("shift", [0.02, -0.03, 0.3, -0.5, 4.0, 1e6])
@pytest.mark.parametrize("at", [0, 1, 50, 103, 104])
def test_an_impossible_stamp_is_replaced(at, shift):
    received = TIMES + 0.01 + np.random.default_rng(3).normal(0, 5e-4, len(TIMES))
    stamps = TIMES.copy()
    stamps[at] += shift
    mended, count, error = plausibility.mend_stamps(stamps, received)
    assert count == 1 and error == pytest.approx(abs(shift), abs=3e-3)
    assert np.abs(mended - TIMES).max() < 3e-3


@pytest.mark.parametrize("shift", [0.0021, -0.0084])
def test_a_small_change_is_noticed_where_delays_are_exact(shift):
    """Simulated runs have constant delays, even if their stamps are irregular."""
    uneven = np.sort(np.concatenate([TIMES, TIMES + 0.0066]))
    stamps = uneven.copy()
    stamps[71] += shift
    mended, count, _ = plausibility.mend_stamps(stamps, uneven + 0.01)
    assert count == 1 and np.abs(mended - uneven).max() < 1e-6


def test_late_or_irregular_stamps_are_not_changed():
    random = np.random.default_rng(4)
    late = TIMES + 0.01 + 0.2 * (random.random(len(TIMES)) < 0.1)  # the recorder's delay
    uneven = np.sort(1000 + 7 * random.random(100))
    burst = np.repeat(TIMES[::5], 5)  # polled
    drift = TIMES + 0.01 + 1e-4 * (TIMES - TIMES[0])
    lost = np.delete(TIMES, slice(30, 60))
    for stamps, received in (
        (TIMES, late),
        (uneven, uneven + 0.01),
        (TIMES[: len(burst)], np.maximum(burst[: len(TIMES)], TIMES[: len(burst)])),
        (TIMES, drift),
        (lost, lost + 0.01),
        (TIMES, np.append(TIMES[:50], TIMES[50:] + 0.5)),  # the clock was set
    ):
        mended, count, _ = plausibility.mend_stamps(stamps, received)
        assert count == 0 and np.array_equal(mended, stamps)


def test_messages_that_overtook_each_other_have_correct_stamps():
    """In their order they are evenly spaced; a stamp that leaves the spacing uneven is not correct."""
    order = np.arange(20)
    order[[5, 6]] = 6, 5
    order[[11, 12, 13]] = 13, 11, 12
    found = plausibility._overtaken(TIMES[order])
    assert np.flatnonzero(found).tolist() == [5, 6, 11, 12, 13]
    assert not plausibility._overtaken(TIMES[:20]).any()
    for off in (0.7, -0.7):  # periods
        wrong = TIMES[:20].copy()
        wrong[9] += off / 15
        assert not plausibility._overtaken(wrong)[:8].any() and not plausibility._overtaken(wrong)[9]
    ends = np.arange(20)
    ends[[0, 1, 18, 19]] = 1, 0, 19, 18  # the first and last have a neighbour on one side only
    assert np.flatnonzero(plausibility._overtaken(TIMES[ends])).tolist() == [0, 19]


def test_commands_unlike_all_others_are_named():
    times, _, inputs = simulate_run()
    assert not list(plausibility.lone_commands(times, inputs[:, 1:], CHANNELS))
    inputs[40, 1] = 0.0625
    (warning,) = plausibility.lone_commands(inputs[:, 0], inputs[:, 1:], CHANNELS)
    assert "left is 0.0625 at %.2f s" % inputs[40, 0] in warning
    # Commands of a controller are all different.
    assert not list(plausibility.lone_commands(times, np.random.random((len(times), 3)), CHANNELS))
    stairs = np.repeat([[0.0, 0, 1], [0.5, 0.5, 1], [1, 1, 1]], 1, axis=0)
    assert not list(plausibility.lone_commands(np.arange(3.0), stairs, CHANNELS))


def test_a_damaged_stamp_in_a_bag_is_reported_and_repaired(tmp_path):
    write_bag(tmp_path / "sound.bag", duration=7, seed=2)
    sound = recording.read_bag(str(tmp_path / "sound.bag"))
    assert not sound.warnings
    data = (tmp_path / "sound.bag").read_bytes()
    stamp = genpy.Time.from_sec(sound.pose_times[313])
    stamp = struct.pack("<LL", stamp.secs, stamp.nsecs)
    at = 4 + data.index(stamp, data.index(stamp) + 1)  # the first match is the time of receipt
    changed = bytearray(data)
    changed[at + 3] ^= 0x10  # changes the nanoseconds by 0.27 s
    (tmp_path / "sound.bag").write_bytes(changed)
    mended = recording.read_bag(str(tmp_path / "sound.bag"))
    assert "single stamps of the poses contradict" in mended.warnings[0]
    np.testing.assert_allclose(mended.pose_times, sound.pose_times, atol=2e-3)
