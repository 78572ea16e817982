"""The missing wrench of a model along a run: the force and moment that would make it follow the poses."""

from dataclasses import dataclass
from typing import List, Tuple

import numpy as np

from ground import _core
from ground.analysis import residuals, windows
from ground.analysis.likelihood import CAP
from ground.support.annotations import Array, Document

IN_A_ROW = 5  # outliers that make a disturbance
EVENT_MARGIN = 0.3  # time cut on both sides of a disturbance [time scales]
MIN_WRENCH = 0.01  # share of full thrust below which a wrench counts as zero
MAP_CELLS = 5  # cells along each side of the map

CHANNEL_NAMES = {"X": "surge force X", "Y": "side force Y", "N": "yaw moment N"}


def full_scale(model: _core.Model) -> Array:
    """What full thrust gives: X, Y [N], N [N m]."""
    force = 2 * model.value("k") * model.input_max
    return np.array([force, force, force * model.value("l")])


@dataclass(frozen=True)
class Undisturbed:
    """A run without its disturbances."""

    run: _core.RunData
    box: _core.GreyBox  # likelihood of its poses
    white: _core.GreyBoxPoint  # the model with the likeliest white wrench
    events: List[Tuple[float, float]]  # start and end of each disturbance [s]


def undisturbed(model: _core.Model, run: _core.RunData) -> Undisturbed:
    """Leaves out the disturbances of a run.

    Walls, hands and wrong poses need far larger wrenches than a missing effect: several poses
    in a row are outliers. A few such pushes would dominate the levels and hide everything else.
    """
    whole = Undisturbed(run, *residuals.disturbance(run, model, "white"), [])
    outlier = np.sum(np.square(whole.box.residuals(whole.white, 0)["whitened"][:, :3]), axis=1) > 0.999 * CAP
    disturbed = np.convolve(outlier, np.ones(IN_A_ROW), "same") == IN_A_ROW
    times, margin = np.array(run.times), EVENT_MARGIN * windows.time_scale([run])
    if not disturbed.any():
        return whole
    groups = np.split(times[disturbed], np.flatnonzero(np.diff(times[disturbed]) > 2 * margin) + 1)
    spans = [(group[0] - margin, group[-1] + margin) for group in groups]
    keep = np.all([(times < start) | (times > end) for start, end in spans], axis=0)
    if keep.mean() < 0.5:
        return whole
    eta, nu, poses = (np.array(values)[keep] for values in (run.eta, run.nu, run.poses))
    rest = run.replaced(times=times[keep], eta=eta, nu=nu, poses=poses)
    events = [(max(a, times[0]), min(b, times[-1])) for a, b in spans]
    return Undisturbed(rest, *residuals.disturbance(rest, model, "white"), events)


@dataclass
class MissingWrench:
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
        means = [world[index.ravel() == i].mean(0) for i in range(len(present))]
        return low + (present + 0.5) * side, np.array(means)


def of_wrench(calm: Undisturbed, model: _core.Model) -> MissingWrench:
    """Infers the missing wrench along an undisturbed run by a Kalman smoother."""
    eta = np.array(calm.run.eta)
    box, point = residuals.disturbance(calm.run, model, "sigma")
    smoothed = box.smooth(point, 0)
    wrench, sigma = smoothed["wrench"], smoothed["sigma"]
    numbers = {
        "disturbances": [{"start": float(a), "end": float(b)} for a, b in calm.events],
        "noise": residuals.levels(point, calm.run, "sigma"),
        "channels": {
            channel: {
                "unit": residuals.UNITS[channel],
                "mean": float(wrench[:, i].mean()),
                "rms": float(np.sqrt((wrench[:, i] ** 2).mean())),
                "std": float(wrench[:, i].std()),
                "sigma": float(np.median(sigma[:, i])),
                "full_scale": float(scale),
            }
            for i, (channel, scale) in enumerate(zip(CHANNEL_NAMES, full_scale(model)))
        },
    }
    return MissingWrench(np.array(calm.run.times), wrench, sigma, eta[:, 2], eta[:, :2], numbers)


def is_negligible(channel: Document) -> bool:
    """Whether a channel of the missing wrench is smaller than its uncertainty or MIN_WRENCH."""
    return bool(channel["rms"] < max(channel["sigma"], MIN_WRENCH * channel["full_scale"]))
