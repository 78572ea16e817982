"""Repair, clocks, replies and layouts of recordings: each part against a plain computation of the same."""
import itertools
import math
import re
import types

import numpy as np
import pytest
from conftest import ROOT, recording_of, write_bag
from test_quality import flown, run_of, same
from test_reply import OWN, PAIR, commands, judged, lagged, motion, recorded

from ground import _core
from ground.errors import GroundError
from ground.recordings import (
    bursts,
    csv_exports,
    frame_clock,
    mapping,
    poses,
    quality,
    readers,
    recording,
    repair,
    reply,
    settings,
    topics,
    tracking_error,
    tracks,
    units,
)
from ground.recordings.bag_reader import Topic
from ground.recordings.layouts import evidence, hypotheses, verdicts, words
from ground.recordings.layouts.hypotheses import Class, Hypothesis, Thruster

# --- headings of a mirrored body


def most_likely(psi, centre):
    """The likeliest of all sequences of mirrored headings, tried one by one."""
    count = len(psi)
    steps = np.pad([float(repair.wrap(b - a)) for a, b in zip(psi, psi[1:])], 7, mode="edge")
    turning = [np.median(steps[i : i + 15]) for i in range(count - 1)]
    best = None
    for mirrored in itertools.product((0, 1), repeat=count):
        readings = [centre - p if m else p for p, m in zip(psi, mirrored)]
        cost = 3.0 * mirrored[0]
        for k in range(1, count):
            off = abs(float(repair.wrap(readings[k] - readings[k - 1] - turning[k - 1])))
            cost += min(20.0, off / (0.02 + 0.3 * abs(turning[k - 1])))
            cost += 3.0 * (mirrored[k] != mirrored[k - 1]) + 0.5 * mirrored[k]
        if best is None or cost < best[0] - 1e-12:
            best = cost, readings, sum(mirrored)
    return best


@pytest.mark.parametrize("seed", range(12))
def test_mirrored_headings_are_the_likeliest_of_all_sequences(monkeypatch, seed):
    random = np.random.default_rng(seed)
    psi = np.cumsum(random.normal(0.05, 0.08, 10)) + random.uniform(-1, 1)
    centre = random.uniform(-1, 1)
    wrong = random.random(10) < (0.2, 0.5, 0.8)[seed % 3]
    read = np.where(wrong, centre - psi, psi) + random.normal(0, 0.03, 10)
    monkeypatch.setattr(repair, "_mirror_centre", lambda psi: centre)
    found, count = repair._unmirror(read)
    cost, readings, expected = most_likely(read, centre)
    assert np.allclose(found, readings) and count == expected


def test_the_centre_of_mirrored_headings_is_exact_in_a_turn():
    psi = 0.1 + 0.12 * np.arange(60)
    for centre in (0.3, -2.0):
        for at in ([5], [5, 20, 41]):
            wrong = psi.copy()
            wrong[at] = centre - psi[at]
            assert repair._mirror_centre(wrong) == pytest.approx(float(repair.wrap(centre)), abs=1e-9)
    assert repair._mirror_centre(psi) is None
    odd = psi.copy()
    odd[[5, 20, 41, 50]] += [1.0, -2.0, 2.6, -1.2]  # whose sums have nothing in common
    assert repair._mirror_centre(odd) is None
    # A heading has to be off by half a radian, between neighbours within 0.3 rad.
    for off, seen in ((0.49, False), (0.51, True)):
        near = psi.copy()
        near[20] += off
        assert (repair._mirror_centre(near) is not None) == seen
    for step, seen in ((0.149, True), (0.151, False)):
        fast = step * np.arange(30)
        fast[10] += 1.0
        assert (repair._mirror_centre(fast) is not None) == seen


def test_the_scatter_of_poses_is_their_noise_whatever_their_motion():
    random = np.random.default_rng(1)
    times = np.arange(4000) / 100
    smooth = np.column_stack([np.sin(times), times, 0.5 * times**2])
    for noise in ([1e-3, 2e-3, 5e-3], [4e-3, 1e-3, 2e-2]):
        found = repair.scatter(times, smooth + random.normal(0, noise, smooth.shape))
        assert found == pytest.approx(noise, rel=0.08)
    for count, known in ((53, True), (52, False)):
        assert (repair.scatter(times[:count], smooth[:count]) is not None) == known
    uneven = np.where(np.arange(4000) % 2, times + 0.0015, times)
    assert repair.scatter(uneven, smooth) is None
    nearly = np.where(np.arange(4000) % 2, times + 0.0005, times)
    assert repair.scatter(nearly, smooth) is not None


# --- frames


def test_steps_cost_what_their_misfit_is():
    random = np.random.default_rng(2)
    steps, single = random.normal(0, 4, (6, 3)), random.normal(0, 2, (6, 3))
    found = frame_clock._step_costs(steps, single)
    assert found.shape == (6, 13)
    for i, count in itertools.product(range(6), (1, 2, 7, 13)):
        cost = sum(
            (s - count * m) ** 2 / (1 + (0.1 * count) ** 2 * (1 + m**2 / 10)) / 2
            for s, m in zip(steps[i], single[i])
        )
        assert found[i, count - 1] == pytest.approx(min(12.0, cost))


@pytest.mark.parametrize("off,share,irregular", [(0.3, 0.03, True), (0.2, 0.5, False), (0.3, 0.01, False)])
def test_intervals_are_irregular_by_a_quarter_in_one_of_fifty(off, share, irregular):
    intervals = np.full(1000, 0.01)
    at = np.linspace(0, 999, int(1000 * share)).astype(int)
    intervals[at] *= 1 + off * (-1) ** np.arange(len(at))
    assert frame_clock._irregular(np.cumsum(intervals)) == irregular
    assert frame_clock._irregular(np.repeat(np.arange(100) / 50, 3))  # most frames share a stamp


def test_single_steps_are_medians_of_nine():
    random = np.random.default_rng(3)
    steps, counts = random.normal(size=(30, 3)), random.integers(1, 4, 30)
    found = frame_clock._single_steps(steps, counts)
    per_frame = np.pad(steps / counts[:, None], ((4, 4), (0, 0)), mode="edge")
    for i in (0, 3, 15, 29):
        assert np.allclose(found[i], np.median(per_frame[i : i + 9], axis=0))


def test_delays_up_to_a_poll_are_free_and_none_is_negative():
    cost = frame_clock._late_cost(np.array([-0.0009, 0.0, 0.0199]), 0.02)
    assert (cost == 0).all()
    later = frame_clock._late_cost(np.array([0.02, 0.04, 0.08]), 0.02)
    assert later == pytest.approx([2, 2 + 2 * np.log(2), 2 + 2 * np.log(4)])
    early = frame_clock._late_cost(np.array([-0.0011, -0.01]), 0.02)
    assert early == pytest.approx([12 + 1.1, 12 + 10])


@pytest.mark.parametrize("seed", range(24))
def test_frame_numbers_are_the_likeliest_of_all(seed):
    """Of four poses whose stamps are late by up to four frames, after a pause that no step can show: all
    sequences are tried."""
    random = np.random.default_rng(seed)
    rate, start = 10.0, 2.0
    true = np.cumsum([0, 1 + random.integers(0, 2), 11 + random.integers(0, 6), 1 + random.integers(0, 2)])
    times = start + true / rate + np.sort(random.uniform(0, 0.12, 4))
    single = random.normal(0, 3, (3, 3))
    steps = np.diff(true)[:, None] * single + random.normal(0, 1, (3, 3))
    steps[1] = 13 * single[1] + random.normal(0, (1, 3, 8)[seed % 3], 3)
    by_step = frame_clock._step_costs(steps, single)
    poll = 1.2 * max(np.median(np.diff(times)), 1 / rate)

    def cost(numbers):
        counts = np.diff(numbers)
        if (counts < 1).any():
            return np.inf
        late = times - start - np.array(numbers) / rate
        lost = sum(3.0 + math.log(n - 1) for n in counts if n > 1)
        moved = sum(row[n - 1] if n <= 13 else 6.0 for row, n in zip(by_step, counts))
        return lost + moved + sum(float(frame_clock._late_cost(one, poll)) for one in late)

    newest = np.floor((times - start + 1e-3) * rate).astype(int)
    every = itertools.product(*[range(n - 3, n + 1) for n in newest])
    least = min(map(cost, every))
    found = frame_clock._most_likely(times, steps, single, rate, start)
    assert cost(found) == pytest.approx(least) and np.isfinite(least)


def test_the_line_of_the_frames_goes_through_the_earliest_stamps():
    random = np.random.default_rng(4)
    for rate, start in ((100.0, 5.0), (240.0, -3.0)):
        numbers = np.cumsum(random.integers(1, 3, 900)) + 50
        late = np.where(random.random(900) < 0.3, 0.0, random.exponential(0.02, 900))
        found, by = frame_clock._line(start + numbers / rate + late, numbers)
        assert by == pytest.approx(rate, rel=1e-5) and found == pytest.approx(start, abs=1e-3)
        times = start + numbers / rate + late
        times[400:] += 3.0  # a pause changes no rate
        numbers[400:] += int(3.0 * rate)
        assert frame_clock._rate(times, numbers) == pytest.approx(rate, rel=1e-3)


def test_roughness_is_the_mean_change_of_velocity():
    random = np.random.default_rng(5)
    times, eta = np.cumsum(random.uniform(0.003, 0.02, 50)), random.normal(size=(50, 3))
    velocity = np.diff(eta, axis=0) / np.diff(times)[:, None]
    change = np.diff(velocity, axis=0) / [4e-4, 4e-4, 6e-3]
    expected = np.mean([np.sqrt((row**2).sum()) for row in change])
    assert frame_clock._roughness(times, eta) == pytest.approx(expected)
    near = times.copy()
    near[20] = near[19] + 1e-5  # stamps that nearly coincide count as 2 ms apart
    assert frame_clock._roughness(near, eta) < 40 * expected


def burst(apart=5e-4, step=0.02, turn=0.0):
    """A craft on its way, with three poses of a burst in reverse order: stamps, poses, places."""
    times = np.arange(20) / 100
    eta = np.column_stack([step * np.arange(20), 0 * times, turn * np.arange(20)])
    times[8:11] = times[8] + apart * np.arange(3)
    order = np.arange(20)
    order[8:11] = [10, 9, 8]
    return times, eta[order], order


def test_a_burst_is_sorted_along_its_way():
    for apart, sorted_ in ((5e-4, True), (9.9e-4, True), (1.1e-3, False)):
        times, eta, order = burst(apart)
        found, moved = bursts.in_order(times, eta)
        assert moved == 2 * sorted_ and (found == (order if sorted_ else np.arange(20))).all(), apart
    # The way of four and more poses has to be 20 times the noise, 0.4 mm.
    ways = {}
    for step in (1.4e-3, 2.5e-3):
        times, eta, _ = burst(step=step)
        ways[step] = bursts.in_order(times, eta)[1]
    assert ways == {1.4e-3: 0, 2.5e-3: 2}
    for heading in (0.0, 1.5, 3.1):  # a craft that turns on the spot
        times, eta, order = burst(step=0.0, turn=0.05)
        assert (bursts.in_order(times, eta + [0, 0, heading])[0] == order).all()
    # A new order leaves half of the roughness at most: the craft itself may zigzag.
    for aside, sorted_ in ((0.012, True), (0.015, False)):  # 42% and 53%
        times, eta, order = burst()
        eta[:, 1] = aside * (-1.0) ** np.arange(20)
        assert (bursts.in_order(times, eta)[1] == 2) == sorted_
    places = np.random.default_rng(1).normal(size=(9, 4))
    assert bursts._roughness(places) == pytest.approx(
        sum(((places[i] - 2 * places[i + 1] + places[i + 2]) ** 2).sum() for i in range(7))
    )


# --- replies


def test_a_lag_of_first_order_is_that_of_small_steps():
    rows = commands(6.0)
    moved = motion(rows)
    given = recorded(rows, moved)
    for tau in (0.05, 0.2):
        times = np.arange(1, 500) / 100
        assert np.allclose(reply._lagged(given, times, tau), lagged(rows, times, tau), atol=0.02)
        assert (reply._lagged(given, np.array([-0.5]), tau) == 0).all()
    late = np.array([rows[-1, 0] + 30.0])
    assert np.allclose(reply._lagged(given, late, 0.2)[0], rows[-1, 1:3])


def test_the_evidence_of_a_lag_is_its_mean_gain_in_ten_blocks():
    rows = commands(20.0)
    moved = motion(rows, 0.25, noise=0.3)
    given = recorded(rows, moved)
    following = reply._Following.of(given, moved)
    delays = np.array([0.0, 0.1])

    def least(lags):
        sums = []
        for tau in reply.TAUS:
            for lag in lags:
                sums.append((following.left(following.times - lag, tau) ** 2).sum(axis=1))
        return min(sums, key=np.sum)

    gain = least(delays) - least([0.25])
    blocks = [part.sum() for part in np.array_split(gain, 10)]
    expected = np.mean(blocks) / (np.std(blocks, ddof=1) / np.sqrt(10))
    assert reply.lag_evidence(given, moved, 0.25, delays) == pytest.approx(expected)
    taus = np.array(reply.TAUS)  # without holes
    assert (taus[0], taus[-1]) == (0.0, 0.3) and (np.diff(taus) > 0).all() and np.diff(taus).max() <= 0.101


def test_what_commands_leave_is_that_of_a_regression():
    rows = commands(20.0)
    moved = motion(rows, 0.1, noise=0.3)
    given = recorded(rows, moved)
    following = reply._Following.of(given, moved)
    assert len(following.times) <= 2000 and (np.diff(following.times) > 0).all()
    assert following.wanted.std(axis=0) == pytest.approx([1, 1, 1])
    assert np.allclose(following.base.T @ following.wanted, 0, atol=1e-8)
    at = following.times - 0.1
    columns = np.column_stack([reply.commands_at(given, at), following.base])
    plain = following.wanted - columns @ np.linalg.lstsq(columns, following.wanted, rcond=None)[0]
    assert np.allclose(following.left(at), plain, atol=1e-8)
    assert following.share(at) == pytest.approx(1 - (plain**2).mean() / (following.wanted**2).mean())
    assert following.middle == pytest.approx((following.times[0] + following.times[-1]) / 2)
    slower = following.at_rate(0.01)
    assert np.diff(slower) == pytest.approx(0.99 * np.diff(following.times))
    few = motion(commands(2.2))
    assert reply._Following.of(recorded(commands(2.2), few), few) is None  # 200 samples are needed


def test_long_recordings_are_thinned_to_two_thousand_samples():
    rows = commands(61.0)
    for rates in (30.0, 100.0):
        moved = motion(rows, rates=rates)
        found = reply._Following.of(recorded(rows, moved), moved)
        inside = reply.middle(moved.times).sum()
        assert len(found.times) == math.ceil(inside / (1 + inside // 2000)) <= 2000


def test_a_rest_is_of_the_heading_as_it_was_measured():
    rows = commands(8.0)
    moved = motion(rows)
    given = recorded(rows, moved)
    names = ("left", "right")
    plain, straight, twisted = (
        reply.rest(given, moved, 0.0, names, *more).accelerations for more in ((), (False,), (True,))
    )
    assert np.array_equal(plain, straight) and not np.allclose(plain, twisted)


def test_outliers_are_cut_at_six_scatters():
    values = np.append(np.linspace(-1, 1, 999), 100.0)[:, None]
    scatter = 1.4826 * np.median(np.abs(values - np.median(values)))
    found = reply._clipped(values)
    assert found[-1, 0] == pytest.approx(np.median(values) + 6 * scatter)
    assert np.array_equal(found[:-1], values[:-1])
    assert np.allclose(reply._clipped(-values), -found)


def test_a_drift_is_not_looked_for_in_short_runs_or_small_shares():
    for duration, looked in ((16.4, True), (15.6, False)):
        rows = commands(duration)
        moved = motion(rows, 0.05, 0.004)
        assert np.isfinite(reply.drift(recorded(rows, moved), moved).error) == looked
    rows = commands(20.0)
    weak = motion(rows, 0.05, noise=1.2)
    given = recorded(rows, weak)
    best = max(
        reply._Following.of(given, weak).share(weak_times - lag)
        for weak_times in [reply._Following.of(given, weak).times]
        for lag in np.arange(-0.1, 0.2, 0.01)
    )
    assert np.isfinite(reply.drift(given, weak).error) == (best > 0.2)


# --- usable parts


@pytest.mark.parametrize("count,levels", [(1, 6), (2, 6), (3, 4), (4, 3), (5, 2), (6, 2)])
def test_grids_of_commands_stay_small(count, levels):
    rows = commands(2.0, count=count)
    names = tuple("abcdefg"[:count]) + ("lift",)
    grid = quality._levels(recording_of(np.arange(9.0), np.zeros((9, 3)), rows, channels=names))
    assert grid.shape == (levels**count, count) and len(np.unique(grid, axis=0)) == levels**count
    assert np.unique(grid).tolist() == pytest.approx(np.linspace(0, 1, levels).tolist())


def test_inputs_of_a_model_are_in_its_own_unit():
    craft = _core.load_model(str(ROOT / "cfg" / "hovercraft" / "mvwt.yaml"))
    times, eta, rows = flown([(3.0, True)])
    names = {channel: i for i, channel in enumerate(craft.channels, 1)}
    assert len(names) == 3 and craft.input_max == 4.5
    data = run_of(times, eta, rows, channels=tuple(names), lift_channel=craft.channels[-1]).data(craft)
    assert np.allclose(np.array(data.inputs), rows * [1, 4.5, 4.5, 1])


def test_runs_of_other_crafts_have_other_commands():
    many = np.random.default_rng(1).random((40, 6))
    assert same(many, many[:, :1], many[:, :3], many.copy()) == [("r0", "r3")]


def test_the_likeliest_twenty_hypotheses_are_listed():
    wild = judged(OWN, noise=20.0)
    still_open = round(wild.open_share * len(hypotheses.classes(PAIR)))
    assert still_open > 21 and len(wild.undecided) == 20
    ratios = [found.ratio for found in wild.undecided]
    assert ratios == sorted(ratios)


def test_frames_that_are_late_by_50_ms_are_counted():
    times, eta, rows = flown([(6.0, True)], nu=(0.4, 0, 0.5))
    run = run_of(np.ceil(times / 0.08 - 1e-9) * 0.08, eta, rows)
    lateness = run.describe()["poses"]["frame_clock"]["lateness"]
    assert lateness["above_50_ms"] == (run.motion.clock.lateness > 0.05).sum() > 50
    assert lateness["above_50_ms"] < 0.6 * len(times)


def test_a_craft_has_moved_by_a_centimetre_or_a_tenth_of_a_radian():
    times, eta, rows = flown([(3.0, False), (1.0, True)])
    for axis, limit in ((0, 0.01), (1, 0.01), (2, 0.1)):
        for factor, moved in ((0.6, False), (1.6, True)):
            other = np.random.default_rng(1).normal(0, [1e-4, 1e-4, 1e-3], eta.shape) + [2.0, -1.0, 0.5]
            other[times > 1.0, axis] += factor * limit
            other[times > 3.0] = eta[times > 3.0] + other[times > 3.0]
            start = run_of(times, other, rows).active[0]
            assert (start < 1.2) == moved, (axis, factor)


def test_a_run_goes_on_while_its_last_command_is_held():
    """A craft that something blocks is driven all the same."""
    times = np.arange(800) / 100
    random = np.random.default_rng(1)
    eta = np.column_stack([0.2 * np.minimum(times, 2.0), 0 * times, 0 * times])
    eta = eta + random.normal(0, [1e-4, 1e-4, 1e-3], eta.shape)
    rows = np.array([[0.0, 1, 0, 1], [1.0, 0, 1, 1], [2.0, 1, 1, 1], [3.5, 0, 0, 1], [8.0, 0, 0, 1]])
    run = run_of(times, eta, rows)
    assert run.active[1] == pytest.approx(3.6)
    driven = rows[:4].copy()
    driven[3] = [3.5, 1, 1, 1]  # to its end
    assert run_of(times, eta, driven).active[1] == pytest.approx(3.5)


def test_rates_do_not_depend_on_the_origin_of_time():
    times, eta, rows = flown([(4.0, True)])
    plain, later = (
        run_of(times + begin, eta, rows + [begin, 0, 0, 0]).describe() for begin in (0.0, 700.0)
    )
    for what in ("poses", "controls"):
        assert later[what]["rate"] == pytest.approx(plain[what]["rate"])
    assert later["duration"] == pytest.approx(plain["duration"])
    assert later["controls"]["end_after_poses"] == pytest.approx(plain["controls"]["end_after_poses"])


def test_errors_of_authorities_are_those_of_a_jackknife():
    rows = commands(20.0)
    moved = motion(rows, noise=0.3)
    given = recorded(rows, moved)
    found = reply.authorities(given, moved, 0.0)
    inside = reply.middle(moved.times)
    inside &= (moved.times > rows[0, 0]) & (moved.times < rows[-1, 0])
    wanted = reply._clipped(reply.accelerations(moved)[inside])
    X = np.column_stack([reply.commands_at(given, moved.times[inside]), reply.smooth_terms(moved.nu[inside])])
    count = len(X)
    block = np.arange(count) * 10 // count
    parts = [np.linalg.lstsq(X[block != b], wanted[block != b], rcond=None)[0][:2] for b in range(10)]
    errors = np.sqrt(9 / 10 * ((parts - np.mean(parts, axis=0)) ** 2).sum(axis=0))
    whole = np.linalg.lstsq(X, wanted, rcond=None)[0][:2]
    for one, value, error in zip(found, whole, errors):
        assert (one.forward, one.right, one.turn) == pytest.approx(tuple(value))
        assert one.errors == pytest.approx(tuple(error))


# --- recordings


def lost(count, left, fit=("x, -y, -z", 0.97), taken=("axes",)):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(recording.units, "fitting_axes", lambda raw: fit)
        rows = types.SimpleNamespace(lost=count, rows={"poses": np.zeros((left, 4))})
        given = types.SimpleNamespace(taken=taken, changes=[types.SimpleNamespace(axes="x, y, z")])
        return recording._lost("f.bag", rows, types.SimpleNamespace(raw=[1], settings=given))


def test_poses_that_are_lost_name_the_axes_that_would_keep_them():
    assert lost(20, 80) == (
        "20% of the poses do not fit the axes 'x, y, z' and were left out: --axes \"x, -y, -z\" fits 97%"
    )
    for more in (dict(count=9, left=91), dict(fit=None), dict(taken=())):
        given = dict(dict(count=20, left=80), **more)
        assert lost(**given) == "%d poses are invalid and were left out" % given["count"]
    assert lost(10, 90).startswith("10% of the poses") and lost(98, 2).startswith("98% of the poses")
    with pytest.raises(GroundError, match="f.bag: 99% of the poses do not fit the axes 'x, y, z'"):
        lost(99, 1)


def test_commands_that_reach_minus_one_may_be_off_there():
    times = np.arange(20) / 10
    pose_rows = np.column_stack([times, times, times, 0 * times])
    for low, said in ((-0.5, True), (-1.0, True), (-1.01, False), (-1.9, False)):
        rows = np.column_stack([times, np.linspace(low, 1, 20), np.ones((20, 2))])
        with pytest.raises(GroundError) as error:
            recording.checked("f.bag", pose_rows, rows, "made up", [])
        assert ("off at -1 has off: -1, full: 1" in str(error.value)) == said
        assert "reach from %g to 1, but they are normalised to 0..1" % low in str(error.value)


def test_a_clock_that_a_mapping_mends_has_no_offset(tmp_path):
    path = str(write_bag(tmp_path / "run.bag", duration=4))
    for given in (mapping.FieldMapping(clock_offset=0.5), mapping.FieldMapping(clock_drift=0.01)):
        found = recording.read_bag(path, given)
        assert found.clock_offset == 0
        stamps = 1000 + np.arange(400) / 100
        assert found.pose_times == pytest.approx(
            stamps + given.clock_offset + given.clock_drift * (stamps - 1000), abs=1e-6
        )


def test_a_pose_that_is_too_far_in_one_coordinate_is_lost(tmp_path):
    def change(times, eta, inputs):
        eta[100, 0], eta[200, 1] = 2e4, -1.1e4
        eta[300, :2] = 3e4
        return times, eta, inputs

    found = recording.read_bag(str(write_bag(tmp_path / "run.bag", duration=4, change=change)))
    assert len(found.eta) == 397 and found.warnings == ["3 poses are invalid and were left out"]
    sound = recording.read_bag(str(write_bag(tmp_path / "sound.bag", duration=4)))
    assert sound.warnings == [] and sound.clock_offset == pytest.approx(0, abs=1e-6)


def test_drives_come_in_the_order_of_their_last_messages(tmp_path):
    import genpy
    import rosbag
    from ground_msgs.msg import Drive

    path = write_bag(tmp_path / "run.bag", duration=4)
    with rosbag.Bag(str(path), "a") as bag:
        for began, said in ((1002.0, 1003.9), (1001.0, 1001.5), (1000.5, 1002.5), (1001.0, 1001.9)):
            message = Drive()
            message.began, message.header.stamp = genpy.Time.from_sec(began), genpy.Time.from_sec(said)
            bag.write("drive", message, genpy.Time.from_sec(said))
    found = recording.read_bag(str(path)).drives
    assert found == pytest.approx(np.array([[1001.0, 1001.9], [1000.5, 1002.5], [1002.0, 1003.9]]))


def test_simulated_bags_have_the_chunks_of_recorded_ones():
    script = (ROOT / "src" / "ground" / "scripts" / "record").read_text()
    (kilobytes,) = re.findall(r'^CHUNK = "(\d+)"', script, re.MULTILINE)
    assert topics.CHUNK == 1024 * int(kilobytes)


def test_topics_of_poses_need_a_message():
    info = {
        "/a/pose": Topic("geometry_msgs/PointStamped", 1),
        "/b/pose": Topic("geometry_msgs/PointStamped", 0),
        "/c/pose": Topic("geometry_msgs/PointStamped", 9),
    }
    assert set(poses.candidates(info, mapping.Poses(), [])) == {"/a/pose", "/c/pose"}
    assert set(poses.candidates(info, mapping.Poses(), ["/c/pose"])) == {"/a/pose"}
    assert set(poses.candidates(info, mapping.Poses(body="c"), [])) == {"/c/pose"}
    assert set(poses.candidates(info, mapping.Poses(body="z"), [])) == {"/a/pose", "/c/pose"}


def test_settings_that_repeat_the_ones_before_are_left_out():
    a, b, c = (settings.Setting(0, "x, y, z", 0.1), settings.Setting(1, "x, y, z", 0.2),
               settings.Setting(2, "x, -y, -z", 0.2))  # fmt: skip
    assert settings._distinct([a, a, b, b, a, c, c, b]) == [a, b, a, c, b]
    assert settings._distinct([]) == []


def test_a_table_of_all_is_its_own_pair(tmp_path):
    assert readers._pair("x.csv", mapping.DEFAULT) == ("x.csv", "x.csv")


def test_exports_have_the_times_that_ros_can_write(tmp_path):
    path = tmp_path / "pose.csv"
    head = ",".join(["%time", *csv_exports.CSV_COLUMNS]) + "\n"
    latest = 2**32 * 10**9 - 1
    path.write_text(head + "1,1,0,0,0\n%d,%d,0,0,0\n" % (latest, latest))
    assert csv_exports.read_csv(str(path))[0] == [1, latest]


def test_bags_of_exports_have_their_times_to_the_nanosecond(tmp_path):
    import rosbag

    head = ",".join(["%time", *csv_exports.CSV_COLUMNS]) + "\n"
    stamps = [1600000000123456789 + 10**7 * i for i in range(20)]
    for name in ("pose", "controls"):
        lines = ["%d,%d,%g,0.5,0.5" % (t + 11, t, 0.01 * i) for i, t in enumerate(stamps)]
        (tmp_path / (name + ".csv")).write_text(head + "\n".join(lines) + "\n")
    counts = csv_exports.write_bag(
        str(tmp_path / "controls.csv"), str(tmp_path / "pose.csv"), str(tmp_path / "run.bag")
    )
    assert counts == {"pose": 20, "controls": 20}
    with rosbag.Bag(str(tmp_path / "run.bag")) as bag:
        for topic in ("pose", "controls"):
            found = list(bag.read_messages([topic]))
            assert [m.header.stamp.to_nsec() for _, m, _ in found] == stamps
            assert [t.to_nsec() for *_, t in found] == [t + 11 for t in stamps]
            assert [m.header.seq for _, m, _ in found] == list(range(20))
            assert [m.point.x for _, m, _ in found] == pytest.approx([0.01 * i for i in range(20)])
    late = [t + 10**9 for t in stamps]
    lines = ["%d,%d,0,0.5,0.5" % (t, t) for t in late]
    (tmp_path / "controls.csv").write_text(head + "\n".join(lines) + "\n")
    with pytest.raises(GroundError, match="do not overlap in time: they are from different runs"):
        csv_exports.write_bag(
            str(tmp_path / "controls.csv"), str(tmp_path / "pose.csv"), str(tmp_path / "b.bag")
        )


# --- tracks


def test_inputs_at_a_millionth_from_their_bounds_are_saturated():
    for value, is_saturated in (
        (0.0, True), (5e-7, True), (1.5e-6, False), (0.5, False), (1 - 1.5e-6, False),
        (1 - 5e-7, True), (1, True),
    ):  # fmt: skip
        assert tracking_error.saturated(np.array([[value, 0.5]]))[0] == is_saturated, value
        assert tracking_error.saturated(np.array([[0.5, value]]))[0] == is_saturated, value
    assert not tracking_error.saturated(np.array([[0.0, 0.5, 0.5]])).any()  # one of three may be off
    assert tracking_error.saturated(np.array([[-1.0, 0.5, 0.5]])).all()
    assert tracking_error.saturated(np.array([[0.0, 0.5], [-0.5, 0.5]])).tolist() == [False, False]


def test_numbers_of_a_track_are_those_of_its_errors():
    errors, inputs = np.array([3.0, 1.0, 2.0]), np.array([[0.0, 0.5], [0.25, 0.75]])
    found = tracking_error.summary(errors, inputs)
    assert found == pytest.approx({
        "rms": math.sqrt(14 / 3), "max": 3.0, "final": 2.0, "saturated_fraction": 0.5,
        "effort": (0.25 + 0.0625 + 0.5625) / 4,
    })  # fmt: skip
    assert set(tracking_error.summary(errors[:0], inputs[:0]).values()) == {None}
    wanted = np.array([[0.5, 0.5], [1.2, 0.5], [0.5, -0.3], [1 + 5e-7, -5e-7]])
    assert tracking_error.wanted_summary(wanted) == {"wanted_outside": 0.5, "wanted_largest": 1.2}
    four = np.array([[-1.0, 0, 0, 1], [-1.1, 0, 0, 0]])
    assert tracking_error.wanted_summary(four) == {"wanted_outside": 0.5, "wanted_largest": 1.1}
    assert tracking_error.compute_ms(np.arange(1001) / 1e6) == pytest.approx(
        {"median": 0.5, "p999": 0.999, "max": 1.0}
    )
    assert tracking_error.compute_ms(np.empty(0)) is None


def test_a_track_needs_two_poses():
    stamps = np.arange(1.0, 3.01, 0.05)
    reference = np.column_stack([stamps] + [0 * stamps] * 4)
    for times, found in (([1.5, 4.0], False), ([0.5, 1.2, 1.21], True)):
        given = recording_of(np.array(times), np.zeros((len(times), 3)), commands(4.0))
        track = tracks._track(given, reference, np.empty((0, 3)), np.empty((0, 2)), [])
        assert (track is not None) == found


# --- units


def moving(speed, count=200):
    times = np.arange(count) / 100
    return times, np.column_stack([speed * times, 0 * times])


def test_units_are_as_likely_as_their_speeds_and_noises():
    """Deviations are factors of 2.5 from 0.6 m/s and of 4 from 0.3 mm."""
    for fast in (20.0, 40.0, 100.0, 500.0, 2000.0):
        for noise in (None, 0.01, 0.3, 3.0):
            off = {}
            for unit, size in mapping.LENGTHS.items():
                off[unit] = abs(math.log(size * fast / 0.6, 2.5))
                if noise:
                    off[unit] += abs(math.log(size * noise / 3e-4, 4))
            ranked = sorted(off, key=off.get)
            expected = tuple(u for u in ranked if off[u] < off[ranked[0]] + 1.7)
            found, by = units.length_units(*moving(fast), noise)
            assert by == pytest.approx(fast)
            assert found == (() if ranked[0] == "m" else expected), (fast, noise)


def test_headings_are_in_degrees_by_jumps_or_speed():
    times = np.arange(300) / 100

    def judged(values):
        return units.in_degrees(times, np.asarray(values, float))

    assert not judged(np.linspace(-6.28, 6.28, 300)) and not judged(np.linspace(0, 20, 300))
    jump = np.where(times < 1.5, 100.0, 100.0 - 301)
    assert judged(jump) and judged(-jump)
    assert not judged(np.where(times < 1.5, 100.0, 100.0 - 299))
    assert not judged(np.where(times < 1.5, 10.0, 10.0 + 360))  # unwrapped radians have no such range
    assert judged(61 * times) and not judged(59 * times)


# --- hypotheses, and what is said of them

NAMES = ("a", "b", "c")


def test_a_heading_offset_is_given_within_half_a_turn():
    def remedy(before, offset, sign=1):
        given = types.SimpleNamespace(
            changes=[types.SimpleNamespace(heading_offset=before, axes="x, y, z")], taken=()
        )
        one = Hypothesis(NAMES, (1, 1, 1), offset, sign)
        return [r for r in words.remedies(one, NAMES, given) if "--heading-offset" in r]

    assert remedy(3.0, math.pi / 2) == ["--heading-offset %.2f" % (3 + math.pi / 2 - 2 * math.pi)]
    assert remedy(-3.0, -0.5) == ["--heading-offset %.2f" % (2 * math.pi - 3.5)]
    assert remedy(0.5, 1.0, -1) == ["--heading-offset 0.50"] and remedy(0.5, 0.0) == []


def test_an_axis_that_is_upside_down_has_its_remedy():
    for taken, remedy in (
        (("axes",), '--axes "x, -y, -z"'),
        ((), "heading: {sign: -1} under poses in a mapping and a minus before one of position's fields under "
             "poses in a mapping"),
    ):  # fmt: skip
        given = types.SimpleNamespace(
            changes=[types.SimpleNamespace(heading_offset=0.0, axes="x, y, z")], taken=taken
        )
        assert words.remedies(Hypothesis(NAMES, (1, 1, 1), 0.0, -1, True), NAMES, given) == [remedy]


def test_turns_of_the_heading_are_named():
    cases = ((math.pi, "half a turn"), (-math.pi, "half a turn"), (math.pi / 2, "a quarter turn"),
             (-math.pi / 2, "a quarter turn"), (-math.pi / 3, "-60 degrees"))  # fmt: skip
    for offset, turn in cases:
        said = words.suppositions(Hypothesis(NAMES, (1, 1, 1), offset), NAMES)
        assert said == "the heading is off by " + turn


def test_a_single_inverted_thruster_is_named():
    assert words.suppositions(Hypothesis(("a",), (-1,)), ("a",)) == "a is inverted"
    assert words.suppositions(Hypothesis(("a", "b"), (-1, 1)), ("a", "b"), True) == "a seems to be inverted"
    assert words.suppositions(Hypothesis(NAMES, (-1, -1, 1)), NAMES, True) == "a and b seem to be inverted"


def test_hypotheses_are_all_ways_that_are_tried():
    for count, orders in ((1, 1), (2, 2), (5, 120), (6, 16), (8, 29)):
        names = "abcdefgh"[:count]
        found = list(hypotheses._orders(names))
        assert len(found) == len(set(found)) == orders and found[0] == tuple(names)
        assert all(sorted(order) == sorted(names) for order in found)
    for count, signs in ((1, 2), (2, 6), (4, 20), (5, 11), (8, 17)):
        found = list(hypotheses._signs(count))
        assert len(found) == len(set(found)) == signs and found[0] == (1,) * count
        assert all(sign.count(0) <= 1 for sign in found)
    pair = [Thruster("left", 0.0, -0.03, 0.0), Thruster("right", 0.0, 0.03, 0.0)]
    every = [h for group in hypotheses.classes(pair) for h in group.members]
    assert len(every) == len(set(every)) == 2 * 6 * 4 * 4
    assert {(h.heading_sign, h.mirrored) for h in every} == {(1, False), (1, True), (-1, False), (-1, True)}
    offsets = {round(h.heading_offset, 6) for h in every}
    assert offsets == {round(k * math.pi / 2, 6) for k in (-1, 0, 1, 2)}
    assert hypotheses.classes(pair)[0].first == Hypothesis(("left", "right"), (1, 1))


def test_effects_of_a_class_are_the_same_up_to_factors():
    three = [Thruster("a", 0.1, -0.03, 0.2), Thruster("b", -0.05, 0.03, -0.4), Thruster("c", 0.0, 0.1, 2.0)]

    def normal(effects):
        force = np.sqrt((effects[:, :2] ** 2).sum()) or 1.0
        moment = np.sqrt((effects[:, 2] ** 2).sum()) or 1.0
        return effects / [force, force, moment]

    groups = hypotheses.classes(three)
    for group in groups[:40] + groups[-5:]:
        costs = [h.cost(NAMES) for h in group.members]
        assert costs == sorted(costs)
        for h in group.members:
            assert h.twisted == group.twisted
            assert np.allclose(normal(h.effects(three)), normal(group.effects), atol=2e-6)
    costs = [group.first.cost(NAMES) for group in groups]
    assert costs == sorted(costs) and costs[0] == 0


def test_intervals_of_ratios_are_of_95_percent():
    found = types.SimpleNamespace(
        shares=lambda index: (0.5, 0.6), classes=[None, types.SimpleNamespace(first="first")]
    )
    one = verdicts._found(found, 1, (np.array([0.0, 0.4]), np.array([0.0, 0.1])))
    assert (one.hypothesis, one.force, one.turn) == ("first", 0.5, 0.6)
    assert one.ratio == pytest.approx(math.exp(0.4))
    assert one.ratio95 == pytest.approx((math.exp(0.4 - 0.196), math.exp(0.4 + 0.196)))


class Turned:
    """What verdicts._turned needs of an Evidence."""

    def __init__(self, first, angle, error, log=-9.0, uncertain=0.1):
        self.classes = [Class((first,), np.zeros((2, 3)))]
        self.of = angle, error, log, uncertain

    def angle(self, index):
        return self.of[:2]

    def log_ratio_of(self, other, index):
        return self.of[2:]


def test_headings_are_turned_by_the_angle_of_the_forces_if_that_is_certain():
    pair = [Thruster("left", 0.0, -0.03, 0.0), Thruster("right", 0.0, 0.03, 0.0)]
    kept, quarter = Hypothesis(("left", "right"), (1, 1)), Hypothesis(("left", "right"), (1, 1), math.pi / 2)

    def turned(first, *of):
        found = verdicts._turned(Turned(first, *of), 0, pair, 4.0)
        return None if found is None else found.heading_offset

    # A force may be the craft's own up to 0.5 rad, beyond the uncertainty of four errors.
    assert turned(kept, 0.71, 0.05) == 0.71 and turned(kept, 0.69, 0.05) is None
    assert turned(kept, -0.51, 0.002) == -0.51 and turned(kept, 0.49, 0.0) is None
    assert turned(kept, 1.0, 0.0, -0.41) == 1.0 and turned(kept, 1.0, 0.0, -0.39) is None
    # Near a quarter turn it is one: within 0.1 rad, or three errors.
    assert turned(quarter, 0.09, 0.0) is None
    assert turned(quarter, -0.11, 0.0) == pytest.approx(math.pi / 2 - 0.11)
    assert turned(quarter, 0.29, 0.1) is None and turned(quarter, 0.31, 0.1) is not None
    assert turned(quarter, 2.0, 0.0) == pytest.approx(math.pi / 2 + 2 - 2 * math.pi)


def why(spread, correlation=0.0, differ=(True, True)):
    sizes = np.outer(spread, spread) * np.array([[1, correlation], [correlation, 1]])
    own = np.zeros((2, 3))
    other = np.where(np.array(differ)[:, None], 1.0, 0.0) * np.ones((2, 3))
    found = types.SimpleNamespace(
        classes=[types.SimpleNamespace(effects=e, twisted=False) for e in (own, other)],
        moments={False: types.SimpleNamespace(sizes=sizes[None])},
    )
    return verdicts._why(found, 0, [1], ("left", "right"))


def test_why_thrusters_are_not_distinguished():
    assert why((0.09, 1.0)) == "left hardly changes" and why((0.11, 1.0)).startswith("their acc")
    assert why((0.09, 1.0), differ=(False, True)).startswith("their accelerations")
    assert why((1, 1), 0.951) == "right and left always change together (correlation 0.95)"
    assert why((1, 1), -0.951).endswith("(correlation -0.95)") and why((1, 1), 0.949).startswith("their")
    assert why((1, 1), 0.99, (True, False)).startswith("their")
    for size in (1e-3, 1e3):  # whatever the unit of the commands
        assert why((size, size), 0.951).startswith("right and left always") and why(
            (size, size), 0.949
        ).startswith("their")
    found = types.SimpleNamespace()
    assert verdicts._why(found, 0, [], ("left", "right")) == ""


def test_of_many_classes_the_likeliest_thousand_are_compared():
    random = np.random.default_rng(1)
    C = random.normal(size=(8, 40, 2))
    A = C @ np.array([[1.0, 0.1, 2.0], [0.8, -0.2, -2.5]]) + 0.1 * random.normal(size=(8, 40, 3))
    own = evidence.Moments(
        np.einsum("bsn,bsc->bnc", C, A), np.einsum("bsn,bsm->bnm", C, C), (A**2).sum(axis=1), 320
    )
    first = Hypothesis(("a", "b"), (1, 1))
    for count in (1000, 1001, 1200):
        classes = [Class((first,), random.normal(size=(2, 3))) for _ in range(count)]
        both = {False: own, True: own}
        kept = evidence._screened(classes, both)
        sums = np.log(evidence._unexplained(classes, both).sum(axis=1)).mean(axis=1)
        expected = sorted(set(np.argsort(sums)[:1000].tolist()) | {0})
        assert [id(group) for group in kept] == [id(classes[i]) for i in expected]


def test_blocks_are_half_a_second_until_there_are_too_many():
    times = np.arange(1000) / 100
    assert len(list(evidence._blocks(times, 400))) in (20, 21)
    lengths = [np.ptp(times[part]) for part in evidence._blocks(times, 5)]
    assert len(lengths) in (5, 6) and max(lengths) == pytest.approx(2.0, abs=0.02)
    for duration, known in ((3.6, True), (2.6, False)):
        rows = commands(duration)
        moved = motion(rows)
        run = types.SimpleNamespace(recording=recorded(rows, moved), motion=moved, reply={"lag": 0.0})
        if known:
            assert len(evidence._moments([run], ("left", "right"), False).totals) >= 6
        else:
            with pytest.raises(GroundError, match="the commands change too little to distinguish"):
                evidence._moments([run], ("left", "right"), False)
