"""The missing wrench of a model along a run: the force and moment that would make it follow the poses."""

from dataclasses import dataclass
from typing import List, Tuple

import numpy as np

from ground import _core
from ground.analysis import residuals
from ground.recordings import repair
from ground.support.annotations import Array, Document

MAX_WRENCH = 3.0  # largest missing wrench, in multiples of full thrust; a larger one is a disturbance
MAX_OUTLIER = 8.0  # the same in robust standard deviations
EVENT_MARGIN = 0.3  # time cut on both sides of a disturbance [s]
MIN_WRENCH = 0.01  # share of full thrust below which a wrench counts as zero
MAP_CELLS = 5  # cells along each side of the map

Span = Tuple[float, float]  # start, end [s]

CHANNEL_NAMES = {"X": "surge force X", "Y": "side force Y", "N": "yaw moment N"}
CHANNEL_UNITS = {"X": "N", "Y": "N", "N": "N m"}


def full_scale(model: _core.Model) -> Array:
    """What full thrust gives: X, Y [N], N [N m]."""
    force = 2 * model.value("k") * model.input_max
    return np.array([force, force, force * model.value("l")])


@dataclass(frozen=True)
class Undisturbed:
    """A run without its disturbances."""

    run: _core.RunData
    filter: _core.WrenchFilter  # along it
    noise: _core.WrenchNoise  # likeliest levels of a random walk
    events: List[Span]  # the disturbances


def undisturbed(model: _core.Model, run: _core.RunData) -> Undisturbed:
    """Leaves out the disturbances of a run.

    Walls, hands and wrong poses need wrenches far larger than those of a missing effect. A few of
    them would dominate the noise levels and hide everything else.
    """
    whole = _core.WrenchFilter(model, run, repair.MAX_GAP)
    noise = whole.likeliest_noise(_core.WrenchNature.random_walk)
    size = np.abs(whole.smooth(noise)["wrench"])
    usual = 1.4826 * np.median(size, axis=0)
    disturbed = (size > np.maximum(MAX_WRENCH * full_scale(model), MAX_OUTLIER * usual)).any(axis=1)
    times = np.array(run.times)
    found: List[List[float]] = []
    for time in times[disturbed]:
        if found and time - EVENT_MARGIN <= found[-1][1]:
            found[-1][1] = time + EVENT_MARGIN
        else:
            found.append([time - EVENT_MARGIN, time + EVENT_MARGIN])
    keep = np.ones(len(times), bool)
    for start, end in found:
        keep &= (times < start) | (times > end)
    if not found or keep.mean() < 0.5:
        return Undisturbed(run, whole, noise, [])
    rest = _core.RunData(
        run.name,
        times[keep],
        np.array(run.eta)[keep],
        np.array(run.nu)[keep],
        run.inputs,
        np.array(run.poses)[keep],
        run.noise,
        run.drives,
    )
    events = [(max(a, times[0]), min(b, times[-1])) for a, b in found]
    without = _core.WrenchFilter(model, rest, repair.MAX_GAP)
    noise = without.likeliest_noise(_core.WrenchNature.random_walk)
    return Undisturbed(rest, without, noise, events)


@dataclass
class Missing:
    """The missing wrench of a model along a run."""

    times: Array  # (n,) [s]
    wrench: Array  # (n, 3) X, Y [N], N [N m], body
    sigma: Array  # (n, 3) standard deviations of its estimate
    heading: Array  # (n,) [rad]
    position: Array  # (n, 2) [m]
    numbers: Document

    def by_place(self) -> Tuple[Array, Array]:
        """Centres (n, 2) x, y [m] of the cells of a map that the craft visited, and the mean missing force
        in each (n, 2) [N], both in world_ned."""
        c, s = np.cos(self.heading), np.sin(self.heading)
        X, Y = self.wrench[:, 0], self.wrench[:, 1]
        world = np.column_stack([c * X - s * Y, s * X + c * Y])
        low, high = self.position.min(axis=0), self.position.max(axis=0)
        side = np.maximum(high - low, 1e-9) / MAP_CELLS
        cell = np.minimum((self.position - low) // side, MAP_CELLS - 1)
        present, index = np.unique(cell, axis=0, return_inverse=True)
        index = index.ravel()
        means = [world[index == i].mean(0) for i in range(len(present))]
        return low + (present + 0.5) * side, np.array(means)


def of_wrench(calm: Undisturbed, model: _core.Model) -> Missing:
    """Infers the missing wrench along an undisturbed run by a Kalman smoother."""
    eta = np.array(calm.run.eta)
    smoothed = calm.filter.smooth(calm.noise)
    wrench, sigma = smoothed["wrench"], smoothed["sigma"]
    numbers: Document = {
        "disturbances": [{"start": float(a), "end": float(b)} for a, b in calm.events],
        "noise": residuals.noise_levels(calm.noise, "N/sqrt(s)", "N m/sqrt(s)"),
        "channels": {
            channel: {
                "unit": CHANNEL_UNITS[channel],
                "mean": float(wrench[:, i].mean()),
                "rms": float(np.sqrt((wrench[:, i] ** 2).mean())),
                "std": float(wrench[:, i].std()),
                "sigma": float(np.median(sigma[:, i])),
                "full_scale": float(scale),
            }
            for i, (channel, scale) in enumerate(zip(CHANNEL_NAMES, full_scale(model)))
        },
    }
    return Missing(np.array(calm.run.times), wrench, sigma, eta[:, 2], eta[:, :2], numbers)


def is_negligible(channel: Document) -> bool:
    """Whether a channel of the missing wrench is smaller than its uncertainty or MIN_WRENCH."""
    return bool(channel["rms"] < max(channel["sigma"], MIN_WRENCH * channel["full_scale"]))
