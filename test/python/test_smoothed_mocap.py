"""Poses that a mocap's software smoothed are recognised, named and read as they were before."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

import ground
from conftest import MODEL, ROOT, identify
from ground.data import measured
from ground.recordings import low_pass, smoothed, suspicions
from ground.recordings.low_pass import LowPass
from ground.recordings.recording import Recording
from ground.support.progress import Work

CASE = ROOT.parent / "shared" / "data" / "cases_2" / "poses_filtered"
LEVER = 0.06  # between markers, by which noise of positions is that of headings [m]
FORMS = sorted(low_pass.POLES)


def flown(seed, rate, noise, effects=(), duration=20.0):
    """A simulated recording of sound poses; noise: of positions [m]."""
    model = ground.Model.load(MODEL)
    for name, values in effects:
        model = model.with_effect(name, **values)
    noises = {"position_noise": noise, "heading_noise": noise / LEVER}
    return ground.simulate(model, "prbs", duration=duration, seed=seed, rate=rate, **noises)


def with_poses(run, change, name="run"):
    """The same run with its poses (n, 3), headings unwrapped, changed and written with six decimals."""
    poses = np.column_stack([run.eta[:, :2], np.unwrap(run.eta[:, 2])])
    poses = np.round(change(poses), 6)
    more = {"channels": run.channels, "name": name}
    return Recording.from_arrays(run.pose_times, poses, run.controls, run.control_times, **more)


def butterworth(corner, rate, both_ways):
    """scipy's low-pass of second order."""
    b, a = signal.butter(2, corner, fs=rate)

    def change(poses):
        once = signal.lfilter(b, a, poses - poses[0], axis=0) + poses[0]
        if not both_ways:
            return once
        return (signal.lfilter(b, a, (once - once[-1])[::-1], axis=0) + once[-1])[::-1]

    return change


def exponential(corner, rate, times):
    """The mean that forgets exponentially, so many times over."""
    keep = np.exp(-2 * np.pi * corner / rate)

    def change(poses):
        for _ in range(times):
            poses = signal.lfilter([1 - keep], [1, -keep], poses - poses[0], axis=0) + poses[0]
        return poses

    return change


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("both_ways", [False, True])
@pytest.mark.parametrize("bilinear", [False, True])
def test_a_low_pass_passes_rest_and_halves_power_or_less_at_its_corner(form, both_ways, bilinear):
    one = LowPass(form, 4.0, 100.0, both_ways, bilinear)
    rest, corner = np.abs(one.response(2 * np.pi * np.array([0.0, 4.0]) / 100))
    assert rest == pytest.approx(1) and 0.2 < corner < 0.75


@pytest.mark.parametrize("form", FORMS)
def test_the_delay_is_that_of_slow_motion(form):
    one, times = LowPass(form, 3.0, 200.0), np.arange(2000) / 200
    late = times[-1] - one.filtered(times[:, None])[-1, 0]
    assert late == pytest.approx(one.delay, abs=1 / 200)
    assert LowPass(form, 3.0, 200.0, both_ways=True).delay == 0


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("both_ways", [False, True])
@pytest.mark.parametrize("bilinear", [False, True])
def test_what_a_low_pass_did_to_motion_is_undone(form, both_ways, bilinear):
    """Also where a pose is lost; what is left out is left out of stamps and poses alike."""
    one = LowPass(form, 5.0, 100.0, both_ways, bilinear, noise=(1e-3, 1e-2), rounding=(1e-9, 1e-9))
    times = np.arange(1500) / 100
    motion = np.column_stack([np.sin(2 * np.pi * f * times + f) for f in (0.3, 0.8, 1.7)])
    kept = np.delete(np.arange(len(times)), [400, 700])
    found_times, found = one.undone(times[kept], one.filtered(motion)[kept])
    wanted = np.column_stack([np.sin(2 * np.pi * f * found_times + f) for f in (0.3, 0.8, 1.7)])
    middle = (found_times > 2) & (found_times < 13)
    assert middle.sum() > 200 and np.abs(found - wanted)[middle].max() < 0.01


@pytest.mark.parametrize("step", [1e-6, 1e-3, 0.25])
def test_the_rounding_of_values_is_found_and_none_where_there_is_none(step):
    values = np.random.default_rng(3).normal(size=500)
    assert smoothed.quantum(np.round(values / step) * step) == pytest.approx(step, rel=1e-3)
    assert smoothed.quantum(values) == 0


@pytest.mark.parametrize("seed, rate, noise, corner, both_ways", [
    (1, 100.0, 3e-4, 4.0, False), (2, 120.0, 1e-3, 8.0, False), (3, 120.0, 5e-4, 4.0, True),
])  # fmt: skip
def test_a_low_pass_is_named_with_its_corner_and_delay(seed, rate, noise, corner, both_ways):
    recording = with_poses(flown(seed, rate, noise), butterworth(corner, rate, both_ways))
    found = recording.motion.low_pass
    assert found.form == "Butterworth" and found.both_ways is both_ways
    assert found.corner == pytest.approx(corner, rel=0.06)
    assert found.noise[0] == pytest.approx(noise, rel=0.2)
    (said,) = [one for one in suspicions.of(recording) if one.kind == "smoothed"]
    assert not said.misread and "smooth" in said.evidence and "switch" in said.remedy
    assert ("late" in said.evidence) is not both_ways


@pytest.mark.parametrize("seed, effects", [
    (5, ()), (6, [("motor_lag", {"tau": 0.06})]), (7, [("input_delay", {"delay": 0.05})]),
])  # fmt: skip
@pytest.mark.parametrize("decimals", [6, 3])
def test_sound_poses_are_read_as_they_are(seed, effects, decimals):
    """White noise, lags of the craft, rounded poses and a position filter that wanders are no smoothing."""
    run = flown(seed, 100.0, 4e-4, effects)
    wander = np.random.default_rng(seed).normal(size=(len(run.eta), 3)) * [3e-5, 3e-5, 5e-4]
    wandering = signal.lfilter([1.0], [1.0, -0.99], wander, axis=0)
    for off in (0.0, wandering):
        recording = with_poses(run, lambda poses, off=off: np.round(poses + off, decimals))
        assert recording.motion.low_pass is None
        assert not [one for one in suspicions.of(recording) if one.kind == "smoothed"]


@pytest.mark.parametrize("change, rate", [
    (butterworth(3.0, 120.0, False), 120.0),
    (butterworth(5.0, 60.0, True), 60.0),
    (exponential(3.0, 100.0, 2), 100.0),
])  # fmt: skip
def test_a_fit_to_smoothed_poses_finds_the_craft(change, rate):
    truth = ground.Model.load(MODEL).core
    start = ground.Model.load(MODEL).with_values({"k": 0.05, "I_z": 7e-5, "N_r": 3e-5, "X_u": 0.01})
    recording = with_poses(flown(8, rate, 5e-4), change)
    found = ground.fit(start, recording).parameters
    for name in ("k", "I_z"):
        assert found[name].value == pytest.approx(truth.value(name), rel=0.03)


def test_a_craft_without_commands_and_one_that_rests_are_not_judged():
    run = flown(9, 100.0, 4e-4, duration=6.0)
    smooth = butterworth(4.0, 100.0, False)
    poses = smooth(np.column_stack([run.eta[:, :2], np.unwrap(run.eta[:, 2])]))
    still = Recording.from_arrays(run.pose_times, poses, 0 * run.controls, run.control_times)
    assert still.motion.low_pass is None
    noise = np.random.default_rng(1).normal(size=poses.shape) * 1e-4
    assert (
        Recording.from_arrays(run.pose_times, noise, run.controls, run.control_times).motion.low_pass is None
    )


@pytest.fixture(scope="module")
def case():
    if not CASE.is_dir():
        pytest.skip("the recordings of shared/data/cases_2 are missing beside the workspace")
    return CASE


def test_info_says_what_the_mocap_does_to_a_public_kind_of_recording(case):
    result = identify("info", case / "run.csv", "--mapping", case / "m.yaml", "--json")
    (found,) = json.loads(result.stdout)
    (said,) = [one for one in found["suspicions"] if one["kind"] == "smoothed"]
    assert "4 Hz" in said["evidence"] and "ms late" in said["evidence"]
    assert abs(found["reply"]["lag"]) < 0.02
    assert found["poses"]["noise"]["position"] > 1e-4


def test_no_false_effect_is_found_in_it_and_the_craft_is_right(case):
    (recording,) = ground.read(case / "run.csv", mapping=case / "m.yaml")
    found = ground.diagnose(case.parent / "start.yaml", recording)
    assert set(found.effects) <= {"input_delay", "motor_lag"}
    for name, value in (("k", 0.062), ("I_z", 8.8e-5)):
        assert found.improved.core.value(name) == pytest.approx(value, rel=0.05)


def test_a_mocap_smooths_all_recordings_or_none():
    """One without commands, which tells no low-pass, is taken as the others are; one that seems to be
    smoothed by chance is not, where the others say no."""
    smooth = butterworth(5.0, 100.0, False)
    runs = [with_poses(flown(20 + i, 100.0, 4e-4), smooth, "run %d" % i) for i in range(3)]
    last = with_poses(flown(30, 100.0, 4e-4), smooth)
    still = Recording.from_arrays(
        last.pose_times, last.eta, 0 * last.controls, last.control_times, name="still"
    )
    assert still.motion.low_pass is None
    found = measured.repaired([*runs, still], Work())
    corners = [run.motion.low_pass.corner for run in found]
    assert corners == pytest.approx([5.0] * 4, rel=0.1)
    sound = [with_poses(flown(40 + i, 100.0, 4e-4), lambda poses: poses, "sound %d" % i) for i in range(4)]
    sound[0].known["motion"] = sound[0].as_before(replace(found[0].motion.low_pass, corner=20.0))
    assert [run.motion.low_pass for run in measured.repaired(sound, Work())] == [None] * 4
