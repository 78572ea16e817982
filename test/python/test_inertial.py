"""The craft's own gyro and accelerometer: read, calibrated against the poses, and in the likelihood."""

import numpy as np
import pytest

import ground
import hidden_cases
from conftest import MODEL, json_of, slow, succeeds
from ground.analysis.likelihood import Likelihood
from ground.checks import quality
from ground.poses import inertial
from ground.poses.inertial import InertialSamples
from ground.reading import readers
from ground.reading.recording import Recording
from ground.support.errors import GroundError

FREE = ("I_z", "X_u", "Y_v", "N_r", "k")


@pytest.fixture(scope="module")
def flown():
    return ground.simulate(MODEL, "prbs", duration=10, seed=4, imu=True, disturbance=(0.03, 0.4))


def without(run):
    return Recording(run.name, run.pose_times, run.eta, run.control_times, run.controls, run.source)


def test_a_user_records_sensors_and_is_told_what_they_add(tmp_path):
    bag = tmp_path / "run.bag"
    succeeds("simulate", "--model", MODEL, "--input", "prbs", "--duration", 8, "--imu", "-o", bag)
    told = succeeds("info", bag)
    line = next(line for line in told.stdout.splitlines() if line.split()[:1] == ["sensors"])
    assert "gyro 100 Hz" in line and "from two poses" in line and "accelerometer" in line
    described = json_of("info", bag)
    assert described[0]["inertial"]["source"].startswith("/sender/telemetry")


def test_a_saved_run_has_the_same_samples(flown, tmp_path):
    flown.save(tmp_path / "run.bag")
    read = readers.read(str(tmp_path / "run.bag")).inertial
    assert np.allclose(read.times, flown.inertial.times, atol=1e-6, rtol=0)
    assert (read.yaw_rate == flown.inertial.yaw_rate).all()
    assert (read.acceleration == flown.inertial.acceleration).all()


def test_a_mapping_leaves_sensors_out_or_names_them(flown, tmp_path):
    flown.save(tmp_path / "run.bag")
    mapping = tmp_path / "M.yaml"

    def read(text):
        mapping.write_text("schema: ground/mapping/1\n" + text)
        return _mapped(tmp_path / "run.bag", mapping)

    assert read("inertial: {use: false}").inertial is None
    assert read("inertial: {topic: /sender/telemetry}").inertial is not None
    other = read(
        "inertial: {topic: /sender/telemetry, yaw_rate: 'gyro[1]', acceleration: ['acc[0]', 'acc[1]']}"
    )
    assert other.inertial is None, "a sensor that only says 0 is none"
    with pytest.raises(GroundError, match="/imu"):
        read("inertial: {topic: /imu}")
    with pytest.raises(GroundError, match="acceleration"):
        read("inertial: {yaw_rate: a}")


def _mapped(bag, path):
    from ground.reading import mapping

    return readers.read(str(bag), mapping.load(str(path)))


def test_columns_of_a_table_are_sensors(flown, tmp_path):
    times = flown.pose_times
    turn = np.interp(times, flown.inertial.times, flown.inertial.yaw_rate)
    push = [np.interp(times, flown.inertial.times, flown.inertial.acceleration[:, c]) for c in range(2)]
    table = np.column_stack([times, flown.eta, flown.held(flown.controls, times), turn, *push])
    names = "t,x,y,psi,left,right,lift,gz,ax,ay"
    np.savetxt(tmp_path / "run.csv", table, delimiter=",", header=names, comments="")
    (tmp_path / "M.yaml").write_text(
        """schema: ground/mapping/1
poses: {time: {field: t}, position: {fields: [x, y]}, heading: {field: psi}}
commands:
  time: {field: t}
  channels: {left: {field: left}, right: {field: right}, lift: {field: lift}}
inertial: {yaw_rate: gz, acceleration: [ax, ay]}
"""
    )
    found = _mapped(tmp_path / "run.csv", tmp_path / "M.yaml")
    assert quality.repaired(found).inertial.problems == ()


def test_units_mounting_place_and_delay_are_found(flown):
    random = np.random.default_rng(1)
    times, r = flown.truth_times, flown.truth_nu[:, 2]
    u, v = flown.truth_nu[:, :2].T
    du, dv, dr = flown.truth_nu_dot.T
    px, py, angle, delay = 0.03, -0.02, 0.6, 0.012
    felt = np.column_stack([du - v * r - dr * py - r * r * px, dv + u * r + dr * px - r * r * py])
    c, s = np.cos(angle), np.sin(angle)
    seen = felt @ np.array([[c, -s], [s, c]]) / 9.81 + [0.02, -0.01] + 0.003 * random.normal(size=felt.shape)
    up = InertialSamples(times + delay, np.degrees(-r) + 0.7, seen * [1, -1], "a sensor with z up")
    found = inertial.calibrate(up, flown.motion)
    assert found.problems == ()
    assert found.gyro_scale == pytest.approx(-np.pi / 180, rel=0.01)
    assert found.acceleration_scale == pytest.approx(9.81, rel=0.05)
    assert found.mounting == pytest.approx(angle, abs=0.05)
    assert found.delay == pytest.approx(delay, abs=2e-3)
    assert np.array(found.data.place) == pytest.approx([px, py], abs=0.01)


@pytest.mark.parametrize("lie", ["noise", "stuck", "other", "few"])
def test_a_sensor_that_lies_is_not_used(flown, lie):
    random = np.random.default_rng(2)
    samples = flown.inertial
    turn, times, push = samples.yaw_rate.copy(), samples.times, samples.acceleration
    if lie == "noise":
        turn = 100 * random.normal(size=len(turn))
    elif lie == "stuck":
        turn[len(turn) // 4 :] = turn[len(turn) // 4]
    elif lie == "other":
        turn = np.roll(turn, len(turn) // 2)
    else:
        turn, times, push = turn[::20], times[::20], push[::20]
    found = inertial.calibrate(InertialSamples(times, turn, push, "liar"), flown.motion)
    assert found.data is None and found.problems


def test_an_accelerometer_that_lies_leaves_the_gyro(flown):
    samples = flown.inertial
    noise = np.random.default_rng(3).normal(size=samples.acceleration.shape)
    found = inertial.calibrate(InertialSamples(samples.times, samples.yaw_rate, noise, "liar"), flown.motion)
    assert found.data is not None and "accelerometer" in found.problems[0]


def test_a_run_without_sensors_has_none(flown):
    run = quality.repaired(without(flown))
    assert run.inertial is None and run.data(ground.Model.load(MODEL).core).inertial is None


def fitted(kind, seed, level, sensed):
    case = hidden_cases.push(hidden_cases.plain(kind, seed), level, level)
    case.imu = sensed
    runs, _ = hidden_cases.record(case)
    like = Likelihood(runs, hidden_cases.given_model(case))
    return case, like, like.fit(hidden_cases.given_model(case), FREE)


@slow
def test_parameters_are_more_certain_and_as_certain_as_they_say():
    away, narrower = [], []
    for seed in range(1, 7):
        _, _, blind = fitted("test_inertial", seed, 0.05, False)
        case, _, fit = fitted("test_inertial", seed, 0.05, True)
        width = {p["name"]: np.ptp(p["ci95"]) for p in blind.parameters}
        for p in fit.parameters:
            away.append((p["value"] - case.body[p["name"]]) / (np.ptp(p["ci95"]) / 3.92))
        narrower.append(
            [np.ptp(p["ci95"]) / width[p["name"]] for p in fit.parameters if p["name"] in "I_z k"]
        )
    assert np.sqrt(np.mean(np.square(away))) < 1.7
    assert np.median(narrower) < 0.8


def test_innovations_and_responses_have_the_sensors_rows():
    _, like, fit = fitted("test_inertial", 1, 0.05, True)
    count = len(like.runs[0].times)
    acting = np.zeros((count, 3))
    acting[:, 2] = 1e-6
    left = like.residuals(fit.point, 0, acting=acting)
    assert left["whitened"].shape == (count, 6)
    assert left["responses"].shape == (6 * count, 1)
    assert 0.2 < np.mean(np.square(left["whitened"][20:, 3:])) < 2
