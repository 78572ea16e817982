"""Usable parts, contacts and numbers of made-up recordings."""

import dataclasses

import numpy as np
import pytest

import ground
from conftest import MODEL, recording_of
from conftest import nominal as model
from ground import _core
from ground.checks import findings, quality
from ground.support.errors import GroundError

NOISE = [3e-4, 3e-4, 5e-3]


def flown(parts, tail=0.0, seed=1, lift=1.0, nu=(0.0, 0.0, 0.0), rate=100.0):
    """Stamps, poses and commands of a craft that is at rest or driven by bursts of random commands: (seconds,
    whether it is driven) of each part; `tail`: time after which the lift ends."""
    random = np.random.default_rng(seed)
    rows, at = [], 0.0
    for seconds, driven in parts:
        count = int(round(seconds * 15))
        bits = random.integers(0, 2, (count, 2)) if driven else np.zeros((count, 2))
        bits[:1] = driven
        rows.append(np.column_stack([at + np.arange(count) / 15, bits, np.full(count, lift)]))
        at += count / 15
    rows = np.vstack(rows + [[[at, 0, 0, 0], [at + tail + 1e-3, 0, 0, 0]]])
    times = np.arange(0, at + tail, 1 / rate)
    model = _core.load_model(str(MODEL))
    eta = _core.simulate(model, rows, times, np.zeros(3), np.array(nu, float))["eta"]
    return times, eta + np.random.default_rng(seed).normal(0, NOISE, eta.shape), rows


def run_of(times, eta, rows, **more):
    return quality.repaired(recording_of(times, eta, rows, **more))


# --- usable spans


def test_a_run_is_usable_from_just_before_the_first_thrust():
    run = run_of(*flown([(2.0, False), (4.0, True)]))
    assert run.zero == 0.0
    assert run.active[0] == pytest.approx(2 - run.margin, abs=1e-6)
    assert run.active[1] == run.end == pytest.approx(5.99)
    ((start, end),) = run.spans
    assert start == pytest.approx(2 - run.margin, abs=0.011) and end == pytest.approx(5.99, abs=1e-6)
    assert run.usable() == pytest.approx(end - start)


@pytest.mark.parametrize("rest,cut", [(0.8, False), (3.0, True)])
def test_a_long_rest_at_the_end_is_left_out(rest, cut):
    """A craft that glides comes to rest only after a while."""
    times, eta, rows = flown([(3.0, True), (rest, False)])
    stops = np.searchsorted(times, 3.2)
    eta[stops:] = eta[stops] + np.random.default_rng(3).normal(0, NOISE, eta[stops:].shape)
    run = run_of(times, eta, rows)
    assert run.active[1] == pytest.approx(3.3 if cut else run.end, abs=0.1)


def test_a_run_ends_with_its_lift():
    run = run_of(*flown([(4.0, True)], tail=0.9))
    assert run.active[1] == pytest.approx(4.0) and run.end == pytest.approx(4.89, abs=0.011)
    times, eta, rows = flown([(1.0, True), (3.0, True)])
    rows[:15, 3] = 0.0  # and begins with it
    assert run_of(times, eta, rows).active[0] == pytest.approx(1.0)
    rows[:, 3] = 0.0  # unless it was not recorded at all
    run = run_of(times, eta, rows)
    assert run.active == (0.0, run.end) and run.drives_by == "start"


def test_gaps_split_the_usable_part_and_short_pieces_are_left_out():
    times, eta, rows = flown([(6.0, True)])
    lost = (
        ((times > 2.0) & (times < 2.2)) | ((times > 4.0) & (times < 4.3)) | ((times > 4.55) & (times < 4.8))
    )
    run = run_of(times[~lost], eta[~lost], rows)
    starts, ends = zip(*run.spans)
    assert starts == pytest.approx([0.0, 2.2, 4.8], abs=0.011)
    assert ends == pytest.approx([2.0, 4.0, 5.99], abs=0.011)
    gaps = findings.described(run)["poses"]["gaps"]
    assert [g["start"] for g in gaps] == pytest.approx([2.0, 4.0, 4.55], abs=0.011)
    assert [g["length"] for g in gaps] == pytest.approx([0.2, 0.3, 0.25], abs=0.02)


# --- when drives began


def test_the_begin_of_a_drive_comes_from_the_record_or_the_lift():
    times, eta, rows = flown([(4.0, True)])
    assert run_of(times, eta, rows).drives_by == "first command"
    recorded = run_of(times, eta, rows, drives=np.array([[-0.5, 3.0]]))
    assert recorded.drives_by == "record" and recorded.drives == pytest.approx([-0.5])
    rows[:8, 3] = 0.0
    lifted = run_of(times, eta, rows)
    assert lifted.drives_by == "lift" and lifted.drives == pytest.approx([rows[8, 0]])


# --- contacts


def wall(at=3.0):
    """A craft that rebounds from a wall."""
    times, eta, rows = flown([(6.0, True)], seed=4)
    craft = model()
    hit = np.searchsorted(times, at)
    before = _core.simulate(craft, rows, times[: hit + 1], np.zeros(3), np.zeros(3))
    nu = np.array(before["nu"][-1]) * [-0.8, -0.8, 1] + [0.3, 0.3, 0]
    after = _core.simulate(craft, rows, times[hit:], before["eta"][-1], nu)
    eta = np.vstack([before["eta"][:-1], after["eta"]])
    return times, eta + np.random.default_rng(1).normal(0, NOISE, eta.shape), rows


def test_a_rebound_from_a_wall_is_a_contact_and_left_out():
    run = run_of(*wall())
    assert run.contacts and all(2.9 < a <= b < 3.1 for a, b in run.contacts)
    first, last = run.contacts[0][0], run.contacts[-1][1]
    used = np.array(run.data(model()).times)
    assert not ((used > first - run.margin) & (used < last + run.margin)).any()
    assert run.spans[0][1] == pytest.approx(first - run.margin, abs=0.011)
    assert run.spans[-1][0] == pytest.approx(last + run.margin, abs=0.011)
    everything = np.array(run.data(model(), everything=True).times)
    assert len(everything) == len(run.motion.times)


@pytest.mark.parametrize("seed", [2, 6])  # the craft is fast when the lift ends
def test_the_floor_is_no_wall_even_if_the_lift_was_not_recorded(seed):
    run = ground.simulate(MODEL, "prbs", duration=10, seed=seed)
    controls = run.controls * [1, 1, 0]
    found = quality.repaired(dataclasses.replace(run, controls=controls))
    assert found.contacts == []
    last = run.control_times[np.flatnonzero(run.thrust.any(axis=1))[-1]] - found.zero
    assert found.active[1] < last + 0.1


def test_a_craft_that_is_carried_away_without_commands_is_noticed():
    times, eta, rows = flown([(6.0, False)])
    eta[300:, :2] += [1.0, 0.5]
    run = run_of(times, eta, rows)
    assert run.reply is None
    assert run.contacts == [pytest.approx((3.0, 3.0), abs=0.011)]


# --- what a fit gets


def test_inputs_are_in_the_order_of_the_model_and_of_its_size():
    times, eta, rows = flown([(3.0, True)])
    run = run_of(times, eta, rows)
    craft = model()
    found = run.inputs(craft)
    assert np.allclose(found, rows)
    data = run.data(craft)
    assert np.allclose(np.array(data.inputs)[:, 1:3], rows[:, 1:3] * craft.input_max)
    assert np.allclose(np.array(data.inputs)[:, 3], rows[:, 3])
    other = run_of(times, eta, rows[:, [0, 3, 2, 1]], channels=("lift", "right", "left"))
    assert np.allclose(other.inputs(craft), found)
    without = run_of(times, eta, rows[:, :3], channels=("left", "right"))
    assert np.allclose(without.inputs(craft), rows * [1, 1, 1, 0])


def test_a_part_of_a_run_can_be_chosen():
    run = run_of(*flown([(5.0, True)]))
    part = np.array(run.data(model(), 1.0, 2.5).times)
    assert part[0] == pytest.approx(1.0) and part[-1] == pytest.approx(2.5)
    assert len(np.array(run.data(model(), 4.0).times)) == 100
    assert len(run.data(model(), 4.90).times) == 10
    with pytest.raises(GroundError, match="only 9 poses.*4.99 s"):
        run.data(model(), 4.91)
    assert np.allclose(np.array(run.data(model()).noise), np.array(run.motion.noise)[[0, 0, 1]])


def test_fits_do_not_see_spikes():
    times, eta, rows = flown([(3.0, True)])
    eta[150] += [0.3, 0.3, 0.0]
    run = run_of(times, eta, rows)
    data = run.data(model())
    assert np.abs(np.array(data.times) - times[150]).min() > 0.005
    assert np.abs(np.array(data.poses) - np.array(data.eta)).max() < 0.05


# --- runs with the same commands


def test_runs_name_those_of_the_same_commands():
    times, eta, rows = flown([(4.0, True)])
    runs = []
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        run = run_of(*flown([(4.0, True)], seed=seed))
        vars(run.recording)["name"] = name
        runs.append(run)
    found = {d["name"]: d["same_inputs_as"] for d in findings.describe(runs)}
    assert found == {"a": ["b"], "b": ["a"], "c": []}
