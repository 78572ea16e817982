"""Experiments with a craft whose motion is written in Python (_core.Plant)."""

import numpy as np
import pytest

from conftest import MODEL, ROOT
from ground import _core
from ground.simulation import experiments
from ground.support.errors import GroundError

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
