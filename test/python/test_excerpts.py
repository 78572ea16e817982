"""Long recordings are searched in parts, and what is said of a craft is the same."""

import numpy as np
import pytest

import ground
from conftest import ROOT, slow
from ground import _core
from ground.analysis import excerpts

FREE_FLYER = ROOT / "cfg" / "craft" / "free_flyer.yaml"
CHANNELS = 8
NOISE = np.array([1.5e-5, 1.5e-5, 1e-4])  # m, m, rad
RATE = 60  # of the poses [Hz]


def pulses(duration, random):
    """Rows of time, eight valves and bearings: a software PWM of 2 Hz."""
    edges = np.arange(0, duration, 0.5)
    width = random.choice([0.0, 0.1, 0.25, 0.4], (len(edges), CHANNELS))
    times = np.unique(np.concatenate([edges, (edges[:, None] + width).ravel()]).round(6))
    begun = np.searchsorted(edges, times, side="right") - 1
    is_open = (times - edges[begun])[:, None] < width[begun] - 1e-9
    return np.column_stack([times, is_open, np.ones(len(times))]).astype(float)


def flown(model, duration, seed):
    """A run of the free-flyer (_core.RunData)."""
    random = np.random.default_rng(seed)
    rows = pulses(duration, random)
    times = np.arange(int(duration * RATE)) / RATE
    eta = _core.simulate(model, rows, times, np.zeros(3), np.zeros(3))["eta"]
    return ground.Recording(
        "run%d" % seed, times, eta + NOISE * random.normal(size=eta.shape), rows,
    )  # fmt: skip
