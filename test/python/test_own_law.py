"""A user's own code in Python: a controller for ground.track, and a craft (_core.Plant)."""

import math
import re
import sys

import numpy as np
import pytest

import ground
from conftest import MODEL, ROOT
from ground import _core
from ground.simulation import experiments
from ground.support.errors import GroundError

MVWT = ROOT / "cfg" / "hovercraft" / "mvwt.yaml"
FOUR = ROOT / "cfg" / "hovercraft" / "four_thrusters.yaml"
GAINS = ROOT / "cfg" / "gains" / "thesis_4_10.yaml"
SHORT = dict(size=1.5, rate_of_turn=0.3, settled=2, end_time=10, max_error=math.inf)


def replayed(run):
    """A law that gives the inputs of a run again."""
    return lambda state, reference, time: run.inputs[np.argmin(abs(run.inputs[:, 0] - time)), 1:]


@pytest.mark.parametrize("model, gains", [(MODEL, None), (MVWT, GAINS)])
def test_a_function_flies_the_craft_as_a_controller_with_the_same_inputs_does(model, gains):
    known = ground.track(model, "circle", gains=gains, **SHORT).runs[0]
    seen = []

    def law(state, reference, time):
        seen.append([time, *state.eta, *reference.p])
        return replayed(known)(state, reference, time)

    found = ground.track(model, "circle", controller=law, **SHORT)
    assert found.controller == "law"
    assert found.runs[0].eta == pytest.approx(known.eta, abs=1e-9)
    # It got the states and the reference that the craft had.
    seen = np.array(seen)
    assert np.diff(seen[:, 0]).min() > 0 and seen[0, 0] == pytest.approx(0, abs=1e-9)
    for columns, truth in ((seen[:, 1:4].T, known.eta.T), (seen[:, 4:].T, known.reference.T)):
        for column, row in zip(columns, truth):
            assert column == pytest.approx(np.interp(seen[:, 0], known.times, row), abs=1e-6)


def test_the_reference_has_its_derivatives():
    points = []

    def law(state, reference, time):
        points.append([time, *map(np.array, reference)])
        return 0, 0

    ground.track(MODEL, "circle", controller=law, **SHORT)
    times = np.array([row[0] for row in points])
    for lower, upper in ((1, 2), (2, 3), (3, 4)):
        values, rates = (np.array([row[i] for row in points]) for i in (lower, upper))
        assert np.gradient(values, times, axis=0)[1:-1] == pytest.approx(rates[1:-1], abs=1e-3)


def test_inputs_out_of_range_are_limited():
    def inputs(value):
        return ground.track(MODEL, "circle", controller=lambda s, r, t: (value, value), **SHORT)

    most, beyond = inputs(1), inputs(7)
    assert beyond.runs[0].eta == pytest.approx(most.runs[0].eta)
    assert beyond.numbers["saturated_fraction"] == 1


def test_several_starts_fly_one_after_the_other(tmp_path):
    times = []

    def law(state, reference, time):
        times.append(time)
        return 0.1, 0.1

    found = ground.track(MODEL, "circle", controller=law, starts=3, **SHORT)
    begins = [i for i, time in enumerate(times) if time == 0]
    assert len(begins) == len(found.runs) == 3
    for first, last in zip(begins, [*begins[1:], len(times)]):
        assert (np.diff(times[first:last]) > 0).all()
    path = found.save(tmp_path / "found.json")
    assert str(ground.load(path)) == str(found)


@pytest.mark.parametrize(
    "answer", [(0.1, math.nan), (0.1, math.inf), (0.1,), (0.1, 0.1, 1), None, "full", [[0.1, 0.1]], 0.5, {}]
)
def test_what_is_no_input_for_each_thruster_is_named(answer):
    def wrong(state, reference, time):
        return answer if time > 1 else (0.1, 0.1)

    with pytest.raises(ground.GroundError) as caught:
        ground.track(MODEL, "circle", controller=wrong, **SHORT)
    said = str(caught.value)
    assert "\n" not in said and repr(answer)[:10] in said and "left, right" in said
    assert re.search(r"wrong, at 1\.0\d s", said)


def test_thrusters_of_another_craft_are_named():
    channels = ground.Model.load(FOUR).core.channels[:-1]
    with pytest.raises(ground.GroundError, match=", ".join(channels)):
        ground.track(FOUR, "circle", controller=lambda s, r, t: (0.1, 0.1), **SHORT)
    found = ground.track(FOUR, "circle", controller=lambda s, r, t: [0.1] * len(channels), **SHORT)
    assert found.runs[0].inputs.shape[1] == 1 + len(channels)


def test_an_error_in_it_is_one_line_with_its_place(tmp_path, monkeypatch):
    file = tmp_path / "my_law.py"
    file.write_text(
        "import numpy as np\n\n\ndef divide(x):\n    return 1 / x\n\n\n"
        "def law(state, reference, time):\n    return divide(time > 1), 0\n\n\n"
        "def solve(state, reference, time):\n    return np.linalg.solve(np.zeros((2, 2)), state.nu[:2])\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    import my_law

    # The line is the last one in the user's file, not in NumPy.
    for law, line, kind in ((my_law.law, 5, "ZeroDivisionError"), (my_law.solve, 13, "LinAlgError")):
        with pytest.raises(ground.GroundError) as caught:
            ground.track(MODEL, "circle", controller=law, **SHORT)
        said = str(caught.value)
        assert "\n" not in said and "%s, line %d" % (file, line) in said and kind in said


def test_ctrl_c_ends_it():
    def interrupted(state, reference, time):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        ground.track(MODEL, "circle", controller=interrupted, **SHORT)


def test_gains_do_not_go_with_it():
    with pytest.raises(ground.OptionError, match="gains"):
        ground.track(MODEL, "circle", controller=lambda s, r, t: (0, 0), gains={"k_e": 1}, **SHORT)
    with pytest.raises(ground.GroundError, match="TrajectoryTracking, ModelPredictive"):
        ground.track(MODEL, "circle", controller="hold", **SHORT)


def test_the_example_of_the_page_follows_a_circle_without_ros(tmp_path, monkeypatch, capsys):
    page = (ROOT / "docs" / "howto" / "controller_python.md").read_text()
    law, script, _ = re.findall(r"^```python\n(.*?)^```", page, re.M | re.S)
    (tmp_path / "hold_point.py").write_text(law)
    for package in ("rospy", "ground_msgs", "ground_msgs.msg"):
        monkeypatch.setitem(sys.modules, package, None)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.chdir(ROOT)
    monkeypatch.delitem(sys.modules, "hold_point", raising=False)
    exec(script, {})
    assert capsys.readouterr().out.endswith("\nTrue\n")


# --- a craft whose motion is written in Python


NOISE = np.array([0.01, 0.02, 0.03])


class Slider(_core.Plant):
    """A craft that slides with a velocity in proportion to its inputs and does not turn. The rigid body
    that the mocap sees is 0.1 m beside it. Every other pose has the error NOISE."""

    def __init__(self, pose):
        super().__init__()
        self.pose, self.velocity = np.array(pose, float), np.zeros(3)
        self.now, self.frames, self.heard = 0.0, 0, []

    def command(self, thrusters, lift):
        self.heard.append((self.now, *thrusters, lift))
        self.velocity = np.array([0.1 * thrusters.sum() * lift, 0, 0])

    def advance(self, time):
        assert time >= self.now
        self.pose[0] += self.velocity[0] * (time - self.now)
        self.now = time

    def state(self):
        return self.pose, self.velocity

    def derivative(self):
        return self.velocity, np.full(3, 0.5)

    def measurement(self):
        return self.pose + [0, 0.1, 0], self.velocity

    def wrench(self):
        return np.array([1e-3, 2e-3, 3e-3])

    def pose_noise(self):
        self.frames += 1
        return NOISE * (self.frames % 2)


def calm():
    mocap = _core.MocapParams()
    mocap.position_noise = mocap.heading_noise = 0.0
    return mocap


def simulate(plant, drive, mocap=None):
    model = _core.load_model(str(MODEL))
    return experiments.simulate(model, drive, mocap=mocap or calm(), plant=plant)


def test_a_schedule_moves_the_plant_and_not_the_model():
    plant = Slider((0.5, 0, 0))
    drive = experiments.with_lift(np.array([[0.0, 1.0, 0.5], [1.0, 0.0, 0.0]]), 2.0)
    run = simulate(plant, drive)
    assert run.truth_eta[0] == pytest.approx([0.5, 0, 0])
    assert run.truth_eta[-1] == pytest.approx([0.65, 0, 0])
    assert run.truth_nu[:, 0].max() == pytest.approx(0.15)
    assert (run.truth_nu_dot == 0.5).all()
    assert (run.truth_wrench == [1e-3, 2e-3, 3e-3]).all()
    np.testing.assert_array_equal(np.array(plant.heard)[:, 1:], run.controls)
    seen = run.truth_eta[: len(run.eta)] + [0, 0.1, 0]
    np.testing.assert_allclose(run.eta[::2], seen[::2] + NOISE)
    np.testing.assert_allclose(run.eta[1::2], seen[1::2])


def test_a_room_bounds_the_plant():
    params = _core.ExcitationParams()
    params.design = experiments.design_params("prbs", seed=1)
    params.room = _core.load_room(str(ROOT / "cfg" / "room" / "room_4x4.yaml"))
    params.duration = 20.0
    plant = Slider((0, 0, 0))
    plant.pose_noise = lambda: np.zeros(3)
    stopped = simulate(plant, params).stopped
    assert "does not follow its commands" in stopped, "it does not move as the model"
    plant.pose, params.link.obedience_timeout = np.zeros(3), 0.0
    plant.now, plant.heard = 0.0, []
    run = simulate(plant, params)
    assert run.bursts >= 1
    assert 1 < run.truth_eta[-1, 0] < 2, "it cannot turn home, so it waits before the wall"
    np.testing.assert_array_equal(np.array(plant.heard)[:, 1:], run.controls)


def test_errors_of_a_plant_are_passed_on():
    drive = experiments.with_lift(np.zeros((1, 3)), 1.0)

    class Broken(Slider):
        def advance(self, time):
            raise ZeroDivisionError("broken at %g s" % time)

    with pytest.raises(ZeroDivisionError, match="broken at 0 s"):
        simulate(Broken((0, 0, 0)), drive)

    class Infinite(Slider):
        def state(self):
            return np.full(3, np.inf), np.zeros(3)

    with pytest.raises(GroundError, match="not finite at 0.000 s"):
        simulate(Infinite((0, 0, 0)), drive)

    class Unfinished(_core.Plant):
        pass

    with pytest.raises(GroundError, match='pure virtual function "Plant::advance"'):
        simulate(Unfinished(), drive)


@pytest.mark.parametrize("count", [9, 1000])
def test_more_thrusters_than_a_craft_can_have_are_refused(count):
    with pytest.raises(ValueError, match="at most 8 thrusters, not %d" % count):
        _core.Plant.command(Slider((0, 0, 0)), np.zeros(count), 1.0)
