"""How motion follows commands: motions that are made of known replies, and the replies that are found."""
import dataclasses
import types

import numpy as np
import pytest
from conftest import recording_of

from ground.recordings import layouts, quality, reply
from ground.recordings.layouts import verdicts
from ground.recordings.repair import Motion

EFFECT = np.array([[0.9, 0.1, 19.0], [0.8, -0.2, -21.0]])  # acceleration by full left, full right thrust
DRAG = np.zeros((11, 3))
DRAG[0] = 0.1, -0.05, 0.3
DRAG[1:4] = [[-0.7, 0.0, 0.1], [0.0, -0.9, 0.5], [0.02, 0.1, -2.0]]
DRAG[4:] = 0.1 * np.random.default_rng(8).normal(size=(7, 3))


def commands(duration=24.0, clock=15.0, seed=1, count=2):
    """Rows of time, random commands of thrusters that change at a clock, and lift."""
    random = np.random.default_rng(seed)
    edges = np.arange(int(duration * clock)) / clock
    return np.column_stack([edges, random.integers(0, 2, (len(edges), count)), np.ones(len(edges))])


def lagged(rows, times, tau):
    """The thrust at some times, after a first-order lag: the plain way, in small steps."""
    found, state, step = [], np.zeros(rows.shape[1] - 2), 1e-3
    for i in range(int(round(times[-1] / step)) + 1):
        held = rows[max(0, np.searchsorted(rows[:, 0], i * step + 1e-9, side="right") - 1), 1:-1]
        found.append(state)
        state = state + (held - state) * (1 - np.exp(-step / tau))
    return np.array(found)[np.round(times / step).astype(int)]


def motion(rows, lag=0.0, rate=0.0, tau=0.0, rates=100.0, effect=EFFECT, drag=DRAG, noise=0.0):
    """A Motion whose accelerations are exactly what commands and velocities say; it follows the commands by
    a lag [s] that grows at a rate [s/s] from the middle on."""
    times = (np.arange(int(rows[-1, 0] * rates)) + 0.3) / rates  # none where commands change
    phases = np.array([1.1, 0.7, 0.5])[:, None] * times + [[0.0], [1.0], [2.0]]
    nu = (0.4 * np.sin(phases) + 0.2 * np.cos(3.1 * phases)).T * [1, 0.5, 5]
    at = times - lag - rate * (times - times.mean())
    index = np.searchsorted(rows[:, 0], at + 1e-9, side="right") - 1
    thrust = np.where(index[:, None] < 0, 0, rows[np.maximum(index, 0), 1:-1])
    if tau:
        thrust = lagged(rows, times, tau)
    wanted = thrust @ effect + reply.smooth_terms(nu) @ drag
    wanted += noise * np.random.default_rng(5).normal(size=wanted.shape) * [1, 1, 20]
    u, v, r = nu.T
    nu_dot = wanted - np.column_stack([-r * v, r * u, 0 * r])
    psi = np.cumsum(r) / rates
    eta = np.column_stack([0 * psi, 0 * psi, psi])
    flags = np.zeros(len(times), bool)
    return Motion(times, eta, eta, nu, nu_dot, (3e-4, 5e-3), flags, flags, None)


def recorded(rows, moved, **more):
    return recording_of(moved.times, moved.eta, rows, **more)


# --- pieces


def test_stretches_are_split_at_gaps_only():
    times = np.concatenate([np.arange(10) * 0.09, 0.81 + 0.101 + np.arange(5) * 0.02])
    inside = np.ones(15, bool)
    parts = reply.stretches(times, inside)
    assert [part.tolist() for part in parts] == [list(range(10)), list(range(10, 15))]
    inside[[0, 4]] = False  # a sample that is missing makes a gap of 0.18 s
    parts = reply.stretches(times, inside)
    assert [part.tolist() for part in parts] == [[1, 2, 3], [5, 6, 7, 8, 9], [10, 11, 12, 13, 14]]
    assert reply.stretches(times, np.zeros(15, bool)) == []


def test_commands_hold_until_the_next_and_are_none_before_the_first():
    rows = np.array([[1.0, 0.2, 0.3, 1.0], [2.0, 0.4, 0.5, 1.0], [2.5, 0.6, 0.7, 1.0]])
    times = np.array([0.0, 0.999, 1.0, 1.999, 2.0, 2.4, 9.0])
    held = reply.commands_at(recording_of(times, np.zeros((7, 3)), rows), times)
    assert held[:, 0].tolist() == [0, 0, 0.2, 0.2, 0.4, 0.4, 0.6]
    assert held[:, 1].tolist() == [0, 0, 0.3, 0.3, 0.5, 0.5, 0.7]


def test_the_force_on_a_craft_that_circles_points_inwards():
    """At a constant speed and yaw rate only the centripetal acceleration is left."""
    moved = motion(commands(2.0))
    n = len(moved.times)
    circle = dataclasses.replace(
        moved, nu=np.tile([2.0, 0.5, 3.0], (n, 1)), nu_dot=np.tile([0.1, 0.2, 0.3], (n, 1))
    )
    found = reply.accelerations(circle)
    assert np.allclose(found, [0.1 - 3 * 0.5, 0.2 + 3 * 2.0, 0.3])


def test_samples_near_the_ends_of_stretches_are_left_out():
    times = np.concatenate([np.arange(100) / 100, 2 + np.arange(100) / 100])
    inside = reply.middle(times, 0.105)
    for begin in (0, 100):
        part = inside[begin : begin + 100]
        assert np.flatnonzero(part).tolist() == list(range(11, 89))
    assert 78 <= reply.middle(times[:100]).sum() < 100  # by default a little less


def test_changes_are_those_of_any_thruster():
    rows = commands(4.0)
    rows[:, 1:3] = 0.5
    rows[10:, 1] = 0.6
    rows[20:, 2] = 0.4
    rows[25:, 2] = 0.4 + 1e-7
    rows[30:, 3] = 0.0  # the lift is no thruster
    assert reply.changes(recording_of(np.arange(9.0), np.zeros((9, 3)), rows)).tolist() == [9, 19]


# --- the reply


@pytest.mark.parametrize("lag", [-0.3, -0.11, 0.0, 0.07, 0.4])
def test_the_reply_is_found_exactly(lag):
    rows = commands()
    moved = motion(rows, lag)
    found = reply.find(recorded(rows, moved), moved)
    assert found["lag"] == pytest.approx(lag, abs=1e-6)
    assert found["share"] == pytest.approx(1.0, abs=1e-6)
    assert np.allclose(found["coefficients"], np.vstack([EFFECT, DRAG]), atol=1e-6)


def test_what_the_commands_do_not_explain_lowers_the_share():
    rows = commands()
    shares = []
    for noise in (0.1, 0.4, 1.0):
        moved = motion(rows, 0.05, noise=noise)
        found = reply.find(recorded(rows, moved), moved)
        assert found["lag"] == pytest.approx(0.05, abs=0.011)
        shares.append(found["share"])
    assert 1 > shares[0] > shares[1] > shares[2] > 0.1
    moved = motion(rows, effect=0 * EFFECT, noise=0.4)
    assert reply.find(recorded(rows, moved), moved) is None


def test_no_reply_is_sought_without_motion_or_changing_commands():
    rows = commands()
    moved = motion(rows)
    still = rows.copy()
    still[:, 1:3] = 0.7
    assert reply.find(recorded(still, moved), moved) is None
    few = motion(commands(0.7))  # 49 samples in the middle
    assert reply.middle(few.times).sum() < 50 and reply.find(recorded(rows, few), few) is None


@pytest.mark.parametrize("lag", [-0.9, -0.36, 0.46, 1.0])
def test_a_reply_is_sought_from_shortly_before_to_shortly_after_the_commands(lag):
    """Larger lags are those of clocks that differ."""
    rows = commands()
    moved = motion(rows, lag)
    found = reply.find(recorded(rows, moved), moved)
    assert found is None or -0.31 < found["lag"] < 0.41 and found["share"] < 0.6


@pytest.mark.parametrize("noise,found", [(0.5, True), (1.0, False)])
def test_a_far_lag_needs_a_third_of_the_accelerations(noise, found):
    """Of which the commands explain 43% and 21%."""
    rows = commands()
    moved = motion(rows, 1.5, noise=noise)
    assert (reply.far_lag(recorded(rows, moved), moved) is not None) == found


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_evidence_does_not_depend_on_units(monkeypatch, scale):
    """It is a mean over its standard error; the sums of squares are given."""
    left = scale * np.random.default_rng(1).uniform(1, 2, (2, 1000))
    sums = types.SimpleNamespace(least=lambda rate, lags: left[int(lags[0])])
    monkeypatch.setattr(reply._Following, "of", classmethod(lambda cls, recording, motion: sums))
    gains = (left[0] - left[1]).reshape(10, 100).sum(axis=1)
    expected = gains.mean() / (gains.std(ddof=1) / np.sqrt(10))
    assert reply.lag_evidence(None, None, 1, np.array([0])) == pytest.approx(expected)
    assert reply.lag_evidence(None, None, 0, np.array([1])) == pytest.approx(-expected)
    assert reply.lag_evidence(None, None, 0, np.array([0])) == 0.0


def test_a_motion_seconds_after_its_commands_is_found():
    rows = commands()
    for lag in (-4.0, 1.5, 4.98):
        moved = motion(rows, lag)
        assert reply.far_lag(recorded(rows, moved), moved) == pytest.approx(lag, abs=1e-6)
    unlike = motion(commands(seed=2), 1.5)
    assert reply.far_lag(recorded(rows, unlike), unlike) is None
    short = motion(commands(2.0))
    assert reply.far_lag(recorded(rows, short), short) is None


# --- two clocks


@pytest.mark.parametrize("rate", [0.01, 0.004, -0.007])
def test_the_drift_of_two_clocks_is_found(rate):
    rows = commands()
    moved = motion(rows, 0.05, rate)
    recording = recorded(rows, moved)
    found = reply.drift(recording, moved)
    assert abs(found.rate - rate) < 3 * found.error and found.error < 1e-3
    assert found.lag == pytest.approx(0.05, abs=0.03)
    assert reply.drift_evidence(recording, moved, found) > 4


def test_one_clock_does_not_drift():
    rows = commands()
    moved = motion(rows, 0.05)
    recording = recorded(rows, moved)
    found = reply.drift(recording, moved)
    assert abs(found.rate) < 2 * found.error
    assert reply.drift_evidence(recording, moved, found) < 2
    short = motion(commands(15.0), 0.0, 0.01)
    assert reply.drift(recorded(rows, short), short) == (0.0, np.inf, 0.0)
    unlike = motion(commands(seed=2))
    assert reply.drift(recorded(rows, unlike), unlike) == (0.0, np.inf, 0.0)


def test_slow_motors_are_no_other_clock():
    rows = commands()
    delays = np.arange(-0.03, 0.155, 0.01)
    slow = motion(rows, tau=0.2)
    assert reply.lag_evidence(recorded(rows, slow), slow, 0.2, delays) < 0
    late = motion(rows, 0.25, noise=0.1)
    assert reply.lag_evidence(recorded(rows, late), late, 0.25, delays) > 5
    short = motion(commands(2.0))
    assert reply.lag_evidence(recorded(rows, short), short, 0.25, delays) == 0


# --- single thrusters


def test_the_authority_of_each_thruster_is_found():
    rows = commands(count=3)
    effect = np.array([[0.9, 0.1, 19.0], [0.8, -0.2, -21.0], [-0.3, 0.7, 2.0]])
    moved = motion(rows, 0.1, effect=effect)
    recording = recorded(rows, moved, channels=("a", "b", "c", "lift"))
    exact = reply.authorities(recording, moved, 0.1)
    assert np.allclose([(a.forward, a.right, a.turn) for a in exact], effect, atol=1e-6)
    assert max(max(a.errors) for a in exact) < 1e-6
    usual = reply.authorities(recording, moved, None)  # a lag of 0.1 s
    assert [a.turn for a in usual] == pytest.approx([a.turn for a in exact])


def test_errors_of_authorities_are_those_of_the_noise():
    rows = commands()
    found = []
    for seed in range(30):
        moved = motion(rows)
        noise = np.random.default_rng(seed).normal(0, 0.3, moved.nu.shape)
        moved = dataclasses.replace(moved, nu_dot=moved.nu_dot + noise)
        found.append(reply.authorities(recorded(rows, moved), moved, 0.0)[0])
    scatter = np.std([(a.forward, a.right, a.turn) for a in found], axis=0)
    said = np.mean([a.errors for a in found], axis=0)
    assert (0.6 * scatter < said).all() and (said < 1.7 * scatter).all()


def test_outliers_do_not_change_authorities():
    rows = commands()
    moved = motion(rows, noise=0.1)
    pushed = dataclasses.replace(moved, nu_dot=moved.nu_dot.copy())
    pushed.nu_dot[500:503] += [1e4, 0, 1e5]
    plain, found = (reply.authorities(recorded(rows, m), m, 0.0)[0] for m in (moved, pushed))
    assert found.forward == pytest.approx(plain.forward, abs=0.05)


def test_authorities_are_of_the_time_with_commands():
    """Whatever happens to the craft before the first and after the last command."""
    rows = commands()
    moved = motion(rows, noise=0.1)
    plain = reply.authorities(recorded(rows[20:-40], moved), moved, 0.0)
    outside = (moved.times < rows[20, 0]) | (moved.times > rows[-41, 0])
    pushed = dataclasses.replace(moved, nu_dot=moved.nu_dot + outside[:, None] * [3.0, -2.0, 50.0])
    assert reply.authorities(recorded(rows[20:-40], pushed), pushed, 0.0) == plain


def test_thrusters_that_always_change_together_have_no_authority_of_their_own():
    rows = commands()
    rows[:, 2] = rows[:, 1]
    moved = motion(rows)
    assert reply.authorities(recorded(rows, moved), moved, 0.0) == []
    few = motion(commands(2.0))
    assert reply.authorities(recorded(commands(2.0), few), few, 0.0) == []


@pytest.mark.parametrize("twisted", [False, True])
def test_the_rest_is_what_velocities_and_slopes_do_not_explain(twisted):
    rows = commands()
    moved = motion(rows, 0.1)
    recording = recorded(rows, moved)
    names = ("left", "right")
    found = reply.rest(recording, moved, 0.1, names, twisted)
    psi = np.interp(found.times, moved.times, moved.eta[:, 2])
    for column in (np.cos(psi), np.sin(psi), np.ones_like(psi)):
        assert np.abs(column @ found.commands).max() < 1e-6
        assert np.abs(column @ found.accelerations).max() < 1e-5
    assert found.times[0] > rows[0, 0] and found.times[-1] < rows[-1, 0]
    part = recorded(rows[20:-40], moved)  # the motion goes on before and after the commands
    inside = reply.middle(moved.times)
    inside &= (moved.times > rows[20, 0]) & (moved.times < rows[-41, 0])
    assert np.array_equal(reply.rest(part, moved, 0.1, names, twisted).times, moved.times[inside])
    if not twisted:  # the commands explain all that is left
        left = found.accelerations - found.commands @ np.linalg.lstsq(
            found.commands, found.accelerations, rcond=None
        )[0]
        assert np.abs(left).max() < 1e-6
        other = reply.rest(recording, moved, 0.1, ("right", "left"))
        assert np.allclose(other.commands, found.commands[:, ::-1])


def test_a_heading_of_the_wrong_sign_is_untwisted():
    """A craft whose heading was measured with the wrong sign: twisted, its rest is that of the craft."""
    rows = commands()
    moved = motion(rows)
    psi = moved.eta[:, 2]
    c, s = np.cos(2 * psi), np.sin(2 * psi)

    def seen(vectors):
        x, y, turn = vectors.T
        return np.column_stack([c * x - s * y, s * x + c * y, -turn])

    accelerations = seen(reply.accelerations(moved))
    nu = seen(moved.nu)
    u, v, r = nu.T
    turning = np.column_stack([-r * v, r * u, 0 * r])
    wrong = dataclasses.replace(
        moved, eta=moved.eta * [1, 1, -1], nu=nu, nu_dot=accelerations - turning
    )
    names = ("left", "right")
    plain = reply.rest(recorded(rows, moved), moved, 0.0, names)
    found = reply.rest(recorded(rows, wrong), wrong, 0.0, names, True)
    assert np.allclose(found.commands, plain.commands, atol=1e-8)
    scale = np.abs(plain.accelerations).max(axis=0)
    assert (np.abs(found.accelerations - plain.accelerations).max(axis=0) < 0.05 * scale).all()


# --- which channel drives which thruster

LEVER = 0.04
PAIR = [layouts.Thruster("left", 0.0, -LEVER, 0.0), layouts.Thruster("right", 0.0, LEVER, 0.0)]
OWN = np.array([[0.9, 0.0, 20.0], [0.9, 0.0, -20.0]])


def turned(effect, angle):
    """Effects as a body sees them whose measured heading is larger by an angle [rad]."""
    c, s = np.cos(angle), np.sin(angle)
    return effect @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def judged(effect, rows=None, noise=0.1, lag=0.0, count=1):
    """The verdict on runs of a craft whose channels have these effects, under the names of a pair."""
    runs = []
    for seed in range(1, 1 + count):
        sent = commands(seed=seed) if rows is None else rows
        moved = motion(sent, lag, effect=np.asarray(effect), noise=noise)
        runs.append(types.SimpleNamespace(recording=recorded(sent, moved), motion=moved, reply={"lag": lag}))
    return verdicts.of_runs(runs, PAIR)


def test_channels_that_are_as_recorded_are_left_so():
    verdict = judged(OWN, lag=0.07)
    assert verdict.is_as_recorded and verdict.best.hypothesis.signs == (1, 1)
    assert verdict.best.ratio == 1 and verdict.best.turn > 0.9 and not verdict.undecided
    assert verdict.why == "" and verdict.open_share < 0.1
    quiet = judged(OWN, noise=0.02)
    assert quiet.best.force > verdict.best.force and quiet.best.turn > verdict.best.turn


@pytest.mark.parametrize(
    "effect,channels,signs,offset",
    [
        (OWN[::-1], ("right", "left"), (1, 1), 0.0),
        (OWN * [[-1], [1]], ("left", "right"), (-1, 1), 0.0),
        (OWN * [[0], [1]], ("left", "right"), (0, 1), 0.0),
        (turned(OWN, np.pi / 2), ("left", "right"), (1, 1), np.pi / 2),
        (turned(OWN, -np.pi / 2), ("left", "right"), (1, 1), -np.pi / 2),
        (turned(OWN, 1.1), ("left", "right"), (1, 1), 1.1),
    ],
)
def test_channels_and_headings_are_found(effect, channels, signs, offset):
    verdict = judged(effect)
    found = verdict.best.hypothesis
    assert (found.channels, found.signs) == (channels, signs)
    assert found.heading_offset == pytest.approx(offset, abs=0.05 if offset == 1.1 else 0)
    assert not verdict.is_as_recorded and verdict.recorded.ratio > 1.2
    low, high = verdict.recorded.ratio95
    assert 1 < low < verdict.recorded.ratio < high
    assert verdict.recorded.hypothesis.channels == ("left", "right")
    both = judged(effect, count=2)
    assert both.best.hypothesis.channels == channels
    assert np.diff(both.recorded.ratio95) < np.diff(verdict.recorded.ratio95)


def test_a_craft_that_pushes_a_little_aside_is_no_turned_heading():
    assert judged(turned(OWN, 0.3)).is_as_recorded  # the craft's own
    verdict = judged(OWN)
    described = verdict.describe()
    assert described["best"]["hypothesis"]["channels"] == ("left", "right")
    assert described["open_share"] == verdict.open_share


def test_what_commands_cannot_decide_has_its_reason():
    rows = commands()
    rows[:, 2] = np.where(np.arange(len(rows)) % 120 == 60, 0.0, 0.5)
    idle = judged(OWN, rows)
    assert idle.is_as_recorded and idle.undecided and idle.why == "right hardly changes"
    rows = commands()
    other = commands(seed=2)[:, 2]
    rows[:, 2] = np.where(np.arange(len(rows)) % 60 == 0, other, rows[:, 1])
    alike = judged(OWN, rows, noise=1.0)
    assert alike.undecided and alike.why.startswith("right and left always change together (correlation 0.9")
    wild = judged(OWN, noise=20.0)
    assert wild.undecided and wild.why.startswith("their accelerations differ by less than")
    assert wild.open_share > 0.3 and wild.is_as_recorded  # what nothing refutes is left as it is


# --- contacts


@pytest.mark.parametrize(
    "push,is_contact",
    [
        ([0, 1.2 * 1.8, 0], True),
        ([0, -1.2 * 1.8, 0], True),
        ([-2.2 * 1.8, 0, 0], True),
        ([0, 0.8 * 1.8, 0], False),
        ([0, 0, 1.7 * 20 + 20], True),
        ([0, 0, -1.7 * 20 - 20], True),
        ([0, 0, 1.3 * 20 - 20], False),
        ([0, 0, 1.4 * 20], False),
        ([0, 0, -1.4 * 20], False),
    ],
)
def test_a_contact_is_more_than_any_input_can_do(push, is_contact):
    """More by the largest force of the thrusters, or by one and a half times their largest moment."""
    rows = commands(12.0)
    moved = motion(rows, effect=OWN)
    found = reply.find(recorded(rows, moved), moved)
    nu_dot = moved.nu_dot.copy()
    nu_dot[500:520] += push
    pushed = dataclasses.replace(moved, nu_dot=nu_dot)
    spans = quality._contacts(recorded(rows, moved), pushed, found)
    if not is_contact:
        assert spans == []
        return
    # By the moment, only while the thrusters turn the craft the same way or not at all.
    times = moved.times
    assert spans and all(times[500] <= a <= b <= times[519] for a, b in spans)
    if not push[2]:
        ((begin, end),) = spans  # but for the first and last sample
        assert (begin, end) == (times[501], times[518])


def test_a_thruster_to_the_side_pushes_as_far_as_one_ahead():
    """The largest force in any direction is the measure of a contact."""
    rows, aside = commands(12.0), np.array([[0.1, 0.9, 20.0], [0.1, 0.9, -20.0]])
    moved = motion(rows, effect=aside)
    found = reply.find(recorded(rows, moved), moved)
    for push, is_contact in (([0.8 * 1.8, 0, 0], False), ([-1.2 * 1.8, 0, 0], True)):
        nu_dot = moved.nu_dot.copy()
        nu_dot[500:520] += push
        spans = quality._contacts(recorded(rows, moved), dataclasses.replace(moved, nu_dot=nu_dot), found)
        assert bool(spans) == is_contact


def test_without_a_reply_only_jumps_are_contacts():
    rows = commands(12.0)
    moved = motion(rows)
    jumps = moved.jumps.copy()
    jumps[[300, 700]] = True
    jumped = dataclasses.replace(moved, jumps=jumps)
    expected = [(moved.times[i], moved.times[i]) for i in (300, 700)]
    assert quality._contacts(recorded(rows, moved), jumped, None) == expected
    found = reply.find(recorded(rows, moved), moved)
    assert quality._contacts(recorded(rows, moved), jumped, found) == expected


def test_levels_of_thrusters_are_a_grid_of_what_they_can_be_given():
    rows = commands(4.0, count=3)
    moved = motion(commands(4.0))
    names = ("a", "b", "c", "lift")
    grid = quality._levels(recorded(rows, moved, channels=names))
    assert len(grid) == len(np.unique(grid, axis=0)) == 4**3
    assert grid.min() == 0 and grid.max() == 1
    rows[3, 2] = -0.5  # one that is reversed
    grid = quality._levels(recorded(rows, moved, channels=names))
    assert grid.min(axis=0).tolist() == [0, -1, 0] and (grid.max(axis=0) == 1).all()
