"""Stamps and commands changed by damage to a file are noticed; merely irregular ones are not."""
import struct

import numpy as np
import pytest
from conftest import simulate_run, write_bag

import genpy
from ground.recordings import plausibility, recording
from ground.recordings.recording import CHANNELS

TIMES = 1000 + np.arange(0, 7, 1 / 15)


def with_flipped_bit(stamp, part, bit):
    """A stamp with a bit of its seconds (part 0) or nanoseconds (1) flipped, as a reader gives it."""
    seconds = int(np.floor(stamp + 5e-10))
    parts = [seconds, round((stamp - seconds) * 1e9)]
    parts[part] ^= 1 << bit
    return parts[0] + 1e-9 * parts[1]


@pytest.mark.parametrize("part,bit", [(0, 0), (0, 9), (0, 31), (1, 25), (1, 27), (1, 29), (1, 31)])
@pytest.mark.parametrize("at", [0, 1, 50, 103, 104])
def test_a_stamp_with_a_flipped_bit_is_mended_exactly(at, part, bit):
    received = TIMES + 0.01 + np.random.default_rng(3).normal(0, 5e-4, len(TIMES))
    stamps = TIMES.copy()
    stamps[at] = with_flipped_bit(stamps[at], part, bit)
    mended, count, error = plausibility.mend_stamps(stamps, received)
    assert count == 1 and error == pytest.approx(abs(stamps[at] - TIMES[at]), abs=3e-3)
    assert np.abs(mended - TIMES).max() < 1e-6


@pytest.mark.parametrize("bit", [21, 23])
def test_a_small_change_is_noticed_where_delays_are_exact(bit):
    """Simulated runs have constant delays, even if their stamps are irregular."""
    uneven = np.sort(np.concatenate([TIMES, TIMES + 0.0066]))
    stamps = uneven.copy()
    stamps[71] = with_flipped_bit(stamps[71], 1, bit)
    mended, count, _ = plausibility.mend_stamps(stamps, uneven + 0.01)
    assert count == 1 and np.abs(mended - uneven).max() < 1e-6


def delayed(seed, who):
    """Stamps and times of receipt of a recording on a busy computer: 1 to 40 messages are late by 5 to
    200 ms, by the network, by a recorder that then takes all that wait, or by a sender that was held up
    before or after it took the stamp."""
    random = np.random.default_rng(seed)
    stamps = 1000 + np.arange(0, 22, 0.01) + random.random()
    if seed % 2:  # commands: periodic ones, and those of an input
        stamps = np.sort(np.concatenate([stamps[::2], stamps[0] + np.arange(0.5, 20, 1 / 15)]))
    late = np.zeros(len(stamps))
    late[random.choice(len(late), random.integers(1, 41), replace=False)] = 1
    late *= random.uniform(5e-3, 0.2, len(late))
    received = stamps + 1e-3 + random.choice([0, 5e-5, 3e-4]) * random.gamma(1, 1, len(stamps))
    if who == "stamp":
        stamps = stamps + 0.1 * late
    else:
        received = received + late * (0.1 if who == "sender" else 1)
    if who == "recorder":
        received = np.maximum.accumulate(received)
    order = np.argsort(received, kind="stable")
    return stamps[order], received[order]


@pytest.mark.parametrize("who", ["network", "recorder", "sender", "stamp"])
def test_a_busy_computer_is_no_damage(who):
    """A delay that is a power of two by chance cannot be distinguished."""
    found = [plausibility.mend_stamps(*delayed(seed, who))[1] for seed in range(50)]
    assert np.count_nonzero(found) <= 1


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


def said(inputs):
    return list(plausibility.lone_commands(inputs[:, 0], inputs[:, 1:], CHANNELS))


@pytest.mark.parametrize("bit", [52, 53, 54, 55, 56, 57])  # of the exponent: 1 becomes 0.5 ... 0
@pytest.mark.parametrize("seed", [1, 2])
def test_a_flipped_bit_of_a_repeated_command_is_named(bit, seed):
    _, _, inputs = simulate_run(seed=seed)
    sent = np.repeat(inputs, 3, axis=0)
    sent[:, 0] = np.arange(len(sent)) / 45
    assert said(sent) == []
    at = 60 + int(np.argmax(sent[60:, 1] == 1))
    for place in (at, at + 1, at + 2):
        damaged = sent.copy()
        damaged[place : place + 1, 1].view(np.uint64)[:] ^= np.uint64(1 << bit)
        (warning,) = said(damaged)
        assert "left is %g at %.2f s" % (damaged[place, 1], damaged[place, 0]) in warning
    other = sent.copy()
    other[at : at + 2, 1] = 0.5  # a level that is used twice
    assert said(other) == []


@pytest.mark.parametrize("levels", [3, 5, 9, 17])
@pytest.mark.parametrize("share", [0.0, 0.9])
def test_a_seldom_level_of_a_coarse_controller_is_no_damage(levels, share):
    """share: of the commands that are at a bound."""
    for seed in range(20):
        random = np.random.default_rng(seed)
        wanted = np.cumsum(random.normal(0, 0.2, (1000, 2)), axis=0)
        wanted = 0.5 + (0.5 + 5 * share) * np.sin(wanted)
        coarse = np.round(np.clip(wanted, 0, 1) * (levels - 1)) / (levels - 1)
        for channel in range(2):  # a level that only one command has
            seldom = random.choice(np.unique(coarse[:, channel]))
            again = np.flatnonzero(coarse[:, channel] == seldom)[1:]
            coarse[again, channel] = coarse[again - 1, channel]
        times = np.arange(1000) / 50
        assert said(np.column_stack([times, coarse, np.ones(1000)])) == []


def test_a_level_cut_by_the_begin_or_end_of_a_recording_is_no_damage():
    levels = np.repeat([0.75, 0.5, 0.25, 0.0, 1.0, 0.25, 0.5], 6)[5:]
    for left in (levels, levels[::-1]):
        sent = np.column_stack([np.arange(len(left)) / 50, left, np.zeros(len(left)), np.ones(len(left))])
        assert said(sent) == []


def test_commands_of_a_continuous_controller_are_no_damage():
    assert said(np.random.default_rng(0).random((3000, 4))) == []
    assert said(np.array([[0.0, 0, 0, 1], [1, 0.5, 0.5, 1], [2, 1, 1, 1]])) == []


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
