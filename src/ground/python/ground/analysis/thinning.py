"""Recordings at a lower rate: neighbouring poses averaged.

Forces on the craft change within tens of milliseconds, and a motion capture's noise is independent
from frame to frame. The mean of two poses within 10 ms therefore has the same information, at half
the work. At full thrust its error is at most a fifth of the noise of heading, as from a delay of
0.05 ms.
"""

import numpy as np

from ground import _core
from ground.support.annotations import Array, Indices

RATE = 50.0  # least rate after thinning [Hz] ...
TOLERANCE = 0.02  # ... up to this share, because steps are rounded: 200 Hz become 50 Hz, not 67 Hz
UNEVEN = 1.5  # a step longer than this multiple of the usual one separates groups


def thinned(run: _core.RunData) -> _core.RunData:
    """A _core.RunData whose samples are means of as many samples as its rate allows; the same run if
    that is one. Its noise is that of the means."""
    times = np.array(run.times)
    step = np.median(np.diff(times)) if len(times) > 1 else 1.0
    count = int((1 + TOLERANCE) / (RATE * step)) if step > 0 else 1
    if count < 2:
        return run
    groups = _groups(times, step, count)

    def mean(values: Array) -> Array:
        return np.asarray(np.add.reduceat(np.array(values), groups, axis=0) / sizes[:, None])

    sizes = np.diff(np.append(groups, len(times)))
    poses = mean(run.poses) if len(run.poses) else np.array(run.poses)
    noise = np.array(run.noise) / np.sqrt(count)
    stamps = mean(times[:, None])[:, 0]
    wrench = mean(run.wrench) if len(run.wrench) else None
    eta, nu = mean(run.eta), mean(run.nu)
    return run.replaced(times=stamps, eta=eta, nu=nu, poses=poses, noise=noise, wrench=wrench)


def by_poses_alone(run: _core.RunData) -> _core.RunData:
    """The run without inertial samples."""
    return run if run.inertial is None else run.replaced(inertial=_core.InertialData())


def _groups(times: Array, step: float, count: int) -> Indices:
    """First samples of groups of at most `count` that follow each other closely."""
    samples = np.arange(len(times))
    begins = np.diff(times, prepend=-np.inf) > UNEVEN * step
    since = samples - np.maximum.accumulate(np.where(begins, samples, 0))
    return np.asarray(np.flatnonzero(since % count == 0))
