"""Defects of recordings that info finds and repairs, each put into a simulated run with known truth."""

import numpy as np
import pytest

from conftest import MODEL, identify, json_of, simulate_run, succeeds, write_bag
from ground import _core
from ground.reading.recording import Recording


def recorded(times, eta, inputs, name="run", offset=0.0):
    return Recording(name, 1000 + times, eta, 1000 + inputs[:, 0], inputs[:, 1:], "a test", offset)


def info(path):
    return json_of("info", path)[0]


def heading_error(found, truth):
    return np.abs(np.angle(np.exp(1j * (found - truth)))).max()


def frames(rate=120.0, duration=8.0, seed=1):
    """Times of camera frames, noisy poses, true velocities, and inputs."""
    model = _core.load_model(str(MODEL))
    _, _, inputs = simulate_run(duration, seed)
    times = 0.003 + np.arange(0, duration - 0.1, 1 / rate)
    run = _core.simulate(model, inputs, times, np.zeros(3), np.zeros(3))
    noise = np.random.default_rng(seed).normal(0, [3e-4, 3e-4, 5e-3], (len(times), 3))
    return times, run["eta"] + noise, run["nu"], inputs


def polled(times, random, poll=0.01):
    """Stamps of frames that a client polls; frames that wait for a late poll arrive together."""
    ticks = np.arange(0, times[-1] + 1, poll) + random.uniform(0, 4e-4)
    ticks = ticks[random.random(len(ticks)) > 0.08]
    stalls = random.choice(ticks, 3)
    ticks = ticks[np.all(np.abs(ticks[:, None] - stalls - 0.07) > 0.06, axis=1)]
    stamps = ticks[np.searchsorted(ticks, times)]
    return stamps + 1e-5 * np.arange(len(times)) / len(times)


def frozen(times, eta, inputs):
    return times, 0 * eta + eta[100], inputs


def idle_and_frozen(times, eta, inputs):
    return times, 0 * eta + eta[100], inputs * [1, 0, 0, 1]


def lift_at_first(times, eta, inputs):
    return times, eta, np.vstack([inputs[:2], inputs[2:] * [1, 1, 1, 0]])


def many_gaps(times, eta, inputs):
    seen = np.arange(len(times)) % 60 < 20
    return times[seen], eta[seen], inputs


def too_short(times, eta, inputs):
    return times[:25], eta[:25], inputs[inputs[:, 0] < 0.3]


@pytest.mark.parametrize(
    "spoil, reason",
    [
        (frozen, "all poses are the same"),
        (idle_and_frozen, "all poses are the same"),
        (lift_at_first, "without lift"),
        (many_gaps, "without a gap"),
        (too_short, "poses follow each other"),
    ],
)
def test_what_is_wrong_with_a_run_of_which_nothing_is_usable_is_said_first(spoil, reason, tmp_path):
    result = succeeds("info", write_bag(tmp_path / "run.bag", change=spoil))
    head = " ".join(result.stdout.split("\n\n")[0].split())
    assert "Usable: 0.0 of" in head and "Next: look at run: no part is usable" in head
    assert reason in head and "nothing to correct" not in head


def test_positions_that_no_command_explains_are_not_called_correct(tmp_path):
    def of_another(times, eta, inputs):
        other = simulate_run(times[-1] + 0.5, 12)[1][: len(times)]
        return times, np.column_stack([other[:, :2], eta[:, 2]]), inputs

    ours, theirs = write_bag(tmp_path / "ours.bag"), write_bag(tmp_path / "theirs.bag", change=of_another)
    heads = [succeeds("info", bag, "--model", MODEL).stdout.split("\n\n")[0] for bag in (ours, theirs)]
    assert "nothing to correct" in heads[0]
    assert "nothing to correct" not in heads[1] and "undecided" in heads[1]


def test_defects_are_found(tmp_path):
    def spoil(times, eta, inputs):
        eta = eta.copy()
        eta[300, 2] *= -1  # one flipped heading
        eta[200] += [0.3, 0, 0]  # one spike
        keep = np.ones(len(times), bool)
        keep[500:540] = False  # a gap of 0.41 s
        times, eta = times[keep], eta[keep]
        times = np.insert(times, 100, times[99])  # a true duplicate
        eta = np.insert(eta, 100, eta[99], axis=0)
        late = np.arange(len(times))
        late[[700, 701]] = 701, 700  # two poses in wrong order
        times, eta = times[late], eta[late]
        return times, eta, inputs[2:]

    path = write_bag(tmp_path / "odd.bag", change=spoil)
    found = info(path)
    assert [round(g["length"], 2) for g in found["poses"]["gaps"]] == [0.41]
    assert found["poses"]["duplicate_stamps"] == 1
    assert found["repairs"]["duplicates dropped"] == 1
    assert found["poses"]["mirrored_headings"] == 1
    assert found["poses"]["stamps_out_of_order"] == 1
    assert found["poses"]["spikes"] == [pytest.approx(2.0 - 2 / 15, abs=0.011)]
    assert found["controls"]["start_after_poses"] == pytest.approx(2 / 15, abs=1e-3)
    assert found["contacts"] == []
    assert len(found["usable"]["spans"]) == 2
    text = identify("info", path).stdout
    for words in ("mocap lost 1 times", "flipped", "spikes", "repeated stamps: 1", "out of order"):
        assert words in text


@pytest.mark.parametrize("seed, rate", [(1, 120.0), (2, 180.0)])
def test_the_frame_clock_of_a_poll_is_rebuilt(seed, rate):
    random = np.random.default_rng(seed)
    times, eta, nu, inputs = frames(rate, seed=seed)
    kept = random.random(len(times)) > 0.05  # some frames are lost
    times, eta, nu = times[kept], eta[kept], nu[kept]
    motion = recorded(polled(times, random), eta, inputs).motion
    assert len(motion.times) == len(times), "no distinct frame may be dropped"
    assert motion.clock.rate == pytest.approx(rate, rel=3e-4)
    off = motion.times - 1000 - times
    # The smallest delay from frame to poll cannot be known; it is the same for all frames.
    assert 0 <= np.median(off) < 3e-3
    # During slow motion or beside a gap a shift by one frame is not detectable.
    assert np.mean(np.abs(off - np.median(off)) < 1e-3) > 0.98
    error = np.sqrt(np.mean((motion.nu - nu) ** 2, axis=0))
    plain = _core.EstimatorParams()
    stamped = _core.smooth(polled(times, np.random.default_rng(seed)), eta, plain)["nu"]
    assert (error < 0.5 * np.sqrt(np.mean((stamped - nu) ** 2, axis=0))).all()


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_late_bursts_in_another_order_are_put_right(seed):
    """As a client stamps a mocap whose frames the network holds up now and then."""
    random = np.random.default_rng(seed)
    times, eta, nu, inputs = frames(50.0, 12.0, seed=seed)
    arrived = times + random.gamma(2, 1e-4, len(times))
    late = np.zeros(len(times), bool)
    for start in np.arange(60, len(times) - 20, 45):
        until = start + random.integers(3, 11)
        late[start:until] = True
        held = arrived[until] - 1e-3 + 1e-4 * np.arange(until - start)
        arrived[start:until] = random.permutation(held)
    order = np.argsort(arrived, kind="stable")
    assert (np.diff(order) < 0).sum() > 10 and late.sum() > 50
    motion = recorded(arrived[order], eta[order], inputs).motion
    assert motion.clock.rate == pytest.approx(50, rel=3e-4)
    off = motion.times - 1000 - times
    assert np.abs(off - np.median(off)).max() < 1e-3
    # Nearly at rest the order is not known, nor does it matter.
    error = np.abs(motion.measured - np.column_stack([eta[:, :2], np.unwrap(eta[:, 2])]))
    assert (error.max(axis=0) < [5e-3, 5e-3, 5e-2]).all()
    assert not len(motion.spikes)
    assert np.sqrt(np.mean((motion.nu - nu)[5:-5] ** 2, axis=0)).max() < 0.2


def test_regular_stamps_are_not_changed():
    times, eta, nu, inputs = frames()
    jitter = np.random.default_rng(1).normal(0, 3e-4, len(times))
    motion = recorded(times + jitter, eta, inputs).motion
    assert motion.clock is None
    assert np.allclose(motion.times, 1000 + times + jitter, rtol=0, atol=1e-9)
    assert motion.noise[0] == pytest.approx(3e-4, rel=0.35)
    assert motion.noise[1] == pytest.approx(5e-3, rel=0.35)


@pytest.mark.parametrize("centre", [0.0, 0.16])
def test_mirrored_headings_are_undone(centre):
    times, eta, nu, inputs = frames()
    truth = eta[:, 2].copy()
    mirrored = np.zeros(len(times), bool)
    random = np.random.default_rng(4)
    for start in random.choice(len(times) - 20, 25, replace=False):
        mirrored[start : start + random.choice([1, 1, 1, 2, 5])] = True
    eta[mirrored, 2] = centre - eta[mirrored, 2]
    eta[:, 2] = np.angle(np.exp(1j * eta[:, 2]))
    motion = recorded(times, eta, inputs).motion
    # A mirrored heading that is wrong by less than the noise cannot be detected.
    kept = np.isin(1000 + times, motion.times)
    assert kept.mean() > 0.99 and heading_error(motion.measured[:, 2], truth[kept]) < 0.15
    # A plain unwrap would leave jumps.
    assert np.abs(np.diff(motion.measured[:, 2])).max() < 0.5
    assert np.sqrt(np.mean((motion.nu[:, 2] - nu[kept, 2]) ** 2)) < 0.3


def test_a_gap_in_a_fast_spin_adds_no_turns():
    times = np.arange(0, 6, 0.01)
    for phase in np.arange(0, 2 * np.pi, 0.5):
        rate = -13 + 4 * np.sin(7.5 * times + phase)
        psi = -13 * times - 4 / 7.5 * np.cos(7.5 * times + phase)
        psi += np.random.default_rng(1).normal(0, 5e-3, len(psi))
        eta = np.column_stack([0 * times, 0 * times, np.angle(np.exp(1j * psi))])
        seen = (times < 3.0) | (times > 3.27)
        recording = Recording("spin", times[seen], eta[seen], times[:2], np.zeros((2, 3)), "nowhere")
        motion = recording.motion
        kept = np.isin(times[seen], motion.times)
        assert kept.sum() > seen.sum() - 5
        assert np.abs(motion.nu[:, 2] - rate[seen][kept]).max() < 3, "at phase %.1f" % phase


def alarms(path):
    """Lines of info about a contact or damage."""
    result = succeeds("info", path)
    text = result.stdout + result.stderr
    return [line for line in text.splitlines() if "no input explains" in line or "damaged" in line]


FAST = ("prbs", "spin", "coast-down", "multilevel-prbs")  # inputs that end while the craft moves


@pytest.mark.parametrize("craft", ["hovercraft/tiny_whoover", "hovercraft/mvwt", "craft/air_table"])
def test_a_sound_simulation_that_ends_on_the_floor_has_no_alarm(craft, tmp_path):
    model = MODEL.parents[1] / (craft + ".yaml")
    for kind in FAST:
        bag = tmp_path / (kind + ".bag")
        options = ("--input", kind, "--seed", 1, "--duration", 10)
        succeeds("simulate", "--model", model, *options, "-o", bag)
        assert alarms(bag) == [], kind


def test_a_run_of_a_busy_recorder_has_no_alarm(tmp_path):
    import genpy
    import rosbag

    assert not alarms(write_bag(tmp_path / "run.bag", duration=8))
    for seed in range(4):
        random = np.random.default_rng(seed)
        busy = tmp_path / ("busy%d.bag" % seed)
        with rosbag.Bag(str(tmp_path / "run.bag")) as source, rosbag.Bag(str(busy), "w") as out:
            for topic, message, at in source.read_messages():
                late = random.uniform(5e-3, 0.2) if random.random() < 0.005 else 3e-4 * random.random()
                out.write(topic, message, at + genpy.Duration.from_sec(late))
        assert alarms(busy) == []


def test_a_pause_of_the_lift_is_left_out_and_no_wall(tmp_path):
    times = np.arange(0, 16, 0.1)
    bits = np.random.default_rng(1).integers(0, 2, (len(times), 2))
    lift = (times < 7) | (times > 9)
    rows = "".join("%.1f,%d,%d,%d\n" % row for row in zip(times, *bits.T, lift))
    (tmp_path / "inputs.csv").write_text("time,left,right,lift\n" + rows)
    options = ("--input", tmp_path / "inputs.csv", "-o", tmp_path / "run.bag")
    succeeds("simulate", "--model", MODEL, *options)
    assert alarms(tmp_path / "run.bag") == []
    found = info(tmp_path / "run.bag")
    (pause,) = found["without_lift"]
    assert pause["end"] - pause["start"] == pytest.approx(2.0, abs=0.15)
    (first, second) = found["usable"]["spans"]
    assert first[1] <= pause["start"] and second[0] >= pause["end"]
