"""Damaged poses, real and simulated ones: no motion is seen that the craft did not make, and fits stay right.

GROUND_DRAWS=1000 tries as many draws, in half an hour.
"""

import math
import os

import numpy as np
import pytest

import ground
from conftest import MODEL, ROOT, SHARED
from ground.checks.quality import RepairedRun
from ground.support.errors import GroundError

DATA = ROOT.parent / "shared" / "data"
DRAWS = int(os.environ.get("GROUND_DRAWS", 6))
needs_data = pytest.mark.skipif(not SHARED.exists(), reason="needs the recordings in ../shared/data")
TRUTH = {"m": 0.0583, "l": 0.0325, "I_z": 8.8e-5, "X_u": 0.0055, "Y_v": 0.0271, "N_r": 4.62e-5, "k": 0.062}
START = {"k": 0.05, "I_z": 7e-5, "X_u": 0.004, "Y_v": 0.02, "N_r": 6e-5}
STEP = 1e-3  # of the flights [s]


@pytest.fixture(scope="module")
def real(real_bags):
    """Real recordings of the thesis's craft, of its successor with four thrusters, and of a free-flyer."""
    runs = [run for bag in real_bags.values() for run in ground.read(bag)]
    runs += ground.read(DATA / "epfl_2019_12", mapping=ROOT / "cfg/mapping/four_thrusters.yaml")
    flyer = DATA / "others" / "stanford_freeflyer"
    runs += ground.read(sorted(flyer.glob("csv/exp_pd*")), mapping=flyer / "mapping_csv.yaml")
    return [RepairedRun(run) for run in runs]


def usable(run):
    """Times [s] of the poses in the usable part, and the largest speed [m/s] and yaw rate [rad/s] there."""
    times, nu = run.motion.times, np.abs(run.motion.nu)
    inside = np.any([(times - run.zero >= a) & (times - run.zero <= b) for a, b in run.spans], axis=0)
    return times[inside], np.hypot(nu[inside, 0], nu[inside, 1]).max(), nu[inside, 2].max()


@needs_data
def test_no_absurd_motion_is_seen_in_real_recordings(real):
    """A tiny whoover goes at 2 m/s and turns at 24 rad/s at most in all sound recordings."""
    for run in real:
        _, speed, rate = usable(run)
        assert speed < 5 and rate < 65, run.recording.name
        assert run.usable() > 0.45 * run.end, run.recording.name


def damaged(random, times, stamps, eta):
    """A part of poses (n, 3) as a worse mocap or network would have given it: stamps, poses, begin and end.
    times: true instants (n,), stamps: those recorded."""
    length = random.uniform(8, 16)
    begin = random.uniform(times[0], max(times[0], times[-1] - length))
    inside = (times >= begin) & (times <= begin + length)
    times, stamps, eta = times[inside], stamps[inside], eta[inside].copy()
    if random.random() < 0.4:  # another client polls the frames
        poll = random.choice([0.008, 0.011, 0.02])
        stamps = np.ceil(times / poll) * poll + np.arange(len(times)) % 8 * 1e-5
    kept = np.ones(len(times), bool)
    if random.random() < 0.4:
        kept = random.random(len(times)) > random.uniform(0, 0.3)
    for _ in range(random.integers(0, 4)):
        gap = random.uniform(begin, begin + length)
        kept &= (times < gap) | (times > gap + random.uniform(0.05, 0.4))
    for _ in range(random.integers(0, 8)):  # the network holds frames up
        end = random.uniform(begin, begin + length)
        late = (stamps > end - random.uniform(0.03, 0.25)) & (stamps < end)
        stamps = np.where(late, end + 2e-5 * np.cumsum(late), stamps)
    odd = random.random(len(times)) < random.uniform(0, 0.03)
    mirrored = random.random() < 0.5
    eta[odd, 2] = np.angle(np.exp(1j * (-eta[odd, 2] if mirrored else eta[odd, 2] + np.pi)))
    order = np.argsort(stamps[kept], kind="stable")
    return stamps[kept][order], eta[kept][order], begin, begin + length


@needs_data
def test_damage_of_real_poses_adds_no_motion_and_costs_few_seconds(real):
    """Cut, thinned, with gaps, late bursts, flips, mirrored headings and another client's stamps."""
    wrong, lost, kept = [], 0, 0
    for seed in range(DRAWS):
        run = real[seed % len(real)]
        recording, clock, (times, speed, rate) = run.recording, run.motion.clock, usable(run)
        order = np.argsort(recording.pose_times, kind="stable")
        stamps, eta = recording.pose_times[order], recording.eta[order]
        # Repeated poses are dropped before the clock is rebuilt: which ones is not known here.
        instants = clock.times if clock and len(clock.times) == len(order) else stamps
        stamps, eta, begin, end = damaged(np.random.default_rng(seed), instants, stamps, eta)
        commands = recording.controls, recording.control_times, recording.channels
        try:
            seen, faster, turning = usable(RepairedRun(ground.Recording.from_arrays(stamps, eta, *commands)))
        except (GroundError, ValueError):  # nothing of it is usable
            seen, faster, turning = np.empty(0), 0.0, 0.0
        if faster > 1.5 * speed or turning > 1.5 * rate:
            wrong.append((seed, recording.name, faster / speed, turning / rate))
        # Fifths of seconds in which the undamaged recording is usable, and poses are left.
        cells = np.unique(np.floor(times[(times > begin) & (times < end)] / 0.2))
        left = np.intersect1d(cells, np.floor(stamps / 0.2))
        lost, kept = lost + len(np.setdiff1d(left, np.floor(seen / 0.2))), kept + len(left)
    assert not wrong
    assert lost < 0.2 * kept


def flight(random, seconds, every):
    """Rows of time [s] and pose of a craft with TRUTH, each `every` steps, and of time and random commands
    left and right. Midpoint rule, written for this test."""
    m, lever, inertia, x_u, y_v, n_r, k = TRUTH.values()
    pose, nu, rows, commands, change = np.array([0.0, 0.0, random.uniform(-3, 3)]), np.zeros(3), [], [], 0.0
    left = right = 0.0

    def slope(pose, nu):
        (_, _, psi), (u, v, r) = pose, nu
        c, s = math.cos(psi), math.sin(psi)
        moved = np.array([u * c - v * s, u * s + v * c, r])
        force = np.array([k * (left + right) - x_u * u, -y_v * v]) / m
        turn = (lever * k * (left - right) - n_r * r) / inertia
        return moved, np.array([force[0] + r * v, force[1] - r * u, turn])

    for i in range(int(seconds / STEP) + 1):
        if i * STEP >= change - 1e-9:
            left, right = random.uniform(0, 0.6, 2) if random.random() < 0.7 else (0.0, 0.0)
            commands.append((i * STEP, left, right))
            change = i * STEP + random.choice([0.1, 0.2, 0.3, 0.5])
        if i % every == 0:
            rows.append((i * STEP, *pose))
        first = slope(pose, nu)
        middle = slope(pose + 0.5 * STEP * first[0], nu + 0.5 * STEP * first[1])
        pose, nu = pose + STEP * middle[0], nu + STEP * middle[1]
    return np.array(rows), np.array(commands)


def mixed(random, rows):
    """Rows of time and pose with a mixture of faults: another run, noise of 0.1 to 10 mm, a compass that a
    table interpolates across its wrap, flips, a piece of other headings, displaced poses, gaps."""
    rows, count = rows.copy(), len(rows)
    if random.random() < 0.3:
        at, turn = random.integers(count // 5, 4 * count // 5), random.uniform(-3, 3)
        c, s = math.cos(turn), math.sin(turn)
        rows[at:, 1:3] = rows[at:, 1:3] @ np.array([[c, s], [-s, c]]) + random.uniform(-2, 2, 2)
        rows[at:, 3] += turn
    noise = 10 ** random.uniform(-4, -2)
    rows[:, 1:3] += random.normal(0, noise, (count, 2))
    measured = rows[:, 3] + random.normal(0, min(10 * noise, 0.05), count)
    if random.random() < 0.3:
        some = np.arange(0, count, random.integers(2, 6))
        measured = np.interp(np.arange(count), some, np.mod(measured[some], 2 * np.pi))
    if random.random() < 0.5:
        odd = random.random(count) < random.uniform(0.002, 0.03)
        measured[odd] += random.choice([np.pi, np.pi / 2, -2.1, 1.2])
    if random.random() < 0.3:
        at = random.integers(0, count - 100)
        measured[at : at + random.integers(3, 100)] += random.choice([np.pi, np.pi / 2])
    rows[:, 3] = np.mod(measured, 2 * np.pi)
    if random.random() < 0.4:
        odd = random.random(count) < random.uniform(0.002, 0.02)
        rows[odd, 1:3] += random.uniform(0.05, 1) * random.choice([-1, 1], 2)
    kept = np.ones(count, bool)
    for _ in range(random.integers(0, 4)):
        at = random.integers(0, count - 60)
        kept[at : at + random.integers(2, 60)] = False
    return rows[kept]


def test_fits_of_mixtures_of_faults_hold_the_truth():
    """k is in its 95% interval in 93% of the draws or more, and no parameter is far from its own."""
    model, outside, far = ground.Model.load(MODEL).with_values(START), 0, []
    for seed in range(DRAWS):
        random = np.random.default_rng(seed)
        rows, sent = flight(random, 20.0, int(random.choice([5, 10, 10, 20])))
        rows = mixed(random, rows)
        commands = np.column_stack([sent[:, 1:], np.ones(len(sent))])
        run = ground.Recording.from_arrays(rows[:, 0], rows[:, 1:], commands, sent[:, 0])
        parameters = ground.fit(model, [run]).parameters
        off = {}
        for name in START:
            one = parameters[name]
            off[name] = abs(one.value - TRUTH[name]) / (np.ptp(one.ci95) / 3.92)
        outside += off["k"] > 1.96
        if max(off.values()) > 4:
            far.append((seed, off))
    expected = 0.07 * DRAWS
    assert outside <= expected + 2.5 * np.sqrt(0.93 * expected)
    assert not far
