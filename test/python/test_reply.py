"""What each thruster does to a craft is found from motions that are made of known replies."""

import numpy as np
import pytest

from conftest import recording_of
from ground import _core
from ground.checks import reply
from ground.poses import kinematics
from ground.poses.repair import Motion

EFFECT = np.array([[0.9, 0.1, 19.0], [0.8, -0.2, -21.0], [-0.3, 0.7, 12.0]])  # accelerations by full thrust
NOISE = (3e-4, 5e-3)
SHARP = _core.RunScales(0.12, 1e9, 1e9)  # accelerations are not smoothed
DRAG = 0.1 * np.random.default_rng(8).normal(size=(11, 3))


def recorded(noise=0.0, seed=5, duration=24.0, together=False):
    """A recording whose accelerations are exactly what commands and velocities say, and noise."""
    random, edges = np.random.default_rng(1), np.arange(int(duration * 15)) / 15
    thrust = random.integers(0, 2, (len(edges), 3)) * 1.0
    if together:
        thrust[:, 1] = thrust[:, 0]
    times = (np.arange(int(duration * 100)) + 0.3) / 100  # none where commands change
    phases = np.array([1.1, 0.7, 0.5])[:, None] * times + [[0.0], [1.0], [2.0]]
    nu = (0.4 * np.sin(phases) + 0.2 * np.cos(3.1 * phases)).T * [1, 0.5, 5]
    at = np.searchsorted(edges, times + 1e-9, side="right") - 1
    wanted = thrust[at] @ EFFECT + kinematics.smooth_terms(nu) @ DRAG
    wanted += noise * np.random.default_rng(seed).normal(size=wanted.shape)
    u, v, r = nu.T
    eta, flags = np.column_stack([0 * r, 0 * r, np.cumsum(r) / 100]), np.zeros(len(times), bool)
    nu_dot = wanted - np.column_stack([-r * v, r * u, 0 * r])
    recording = recording_of(times, eta, np.column_stack([edges, thrust]), channels=("a", "b", "c"))
    recording.known["motion"] = Motion(times, eta, eta, nu, nu_dot, NOISE, SHARP, flags, flags, None)
    return recording


def test_the_authority_of_each_thruster_is_found():
    found = reply.authorities(recorded())
    assert list(found) == ["a", "b", "c"]
    assert np.allclose([(a["forward"], a["right"], a["turn"]) for a in found.values()], EFFECT, atol=1e-6)
    assert max(max(a["errors"]) for a in found.values()) < 1e-6
    assert reply.find(recorded())["lag"] == pytest.approx(0, abs=1e-9)


def test_thrusters_that_always_change_together_have_no_authority_of_their_own():
    assert reply.authorities(recorded(together=True)) == {}
    assert reply.authorities(recorded(duration=1.0)) == {}
