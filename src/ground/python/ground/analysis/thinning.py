"""Recordings at a lower rate: neighbouring poses averaged.

Forces on the craft change within tens of milliseconds, and a motion capture's noise is independent
from frame to frame. The mean of two poses within 10 ms therefore has the same information, at half
the work. At full thrust its error is at most a fifth of the noise of heading, as from a delay of
0.05 ms. Slow craft are thinned further, as long as the mean's error stays as small: over a time T, an
acceleration a moves it by a T^2 / 24.
"""

from typing import Union

import numpy as np

from ground import _core
from ground.analysis import windows
from ground.poses import scatter
from ground.support.annotations import Array, Flags, Indices

RATE = 50.0  # least rate after thinning [Hz], and per time scale of a slower craft ...
TOLERANCE = 0.02  # ... up to this share, because steps are rounded: 200 Hz become 50 Hz, not 67 Hz
ERROR = 0.2  # most error of a mean, in the noise of a pose
UNEVEN = 1.5  # a step longer than this multiple of the usual one separates groups


def thinned(run: _core.RunData) -> _core.RunData:
    """A _core.RunData whose samples are means of as many samples as its rate allows; the same run if
    that is one. Its noise is the noise of the means."""
    times = np.array(run.times)
    step = scatter.interval(times)
    count = int((1 + TOLERANCE) * _span(run) / step)
    if count < 2:
        return run
    groups = _groups(times, step, count)

    def mean(values: Array) -> Array:
        return np.asarray(np.add.reduceat(np.array(values), groups, axis=0) / sizes[:, None])

    sizes = np.diff(np.append(groups, len(times)))
    noise = np.array(run.noise) / np.sqrt(count)
    eta, nu, poses, wrench = (
        mean(values) if len(values) else None for values in (run.eta, run.nu, run.poses, run.wrench)
    )
    stamps = mean(times[:, None])[:, 0]
    return run.replaced(times=stamps, eta=eta, nu=nu, poses=poses, noise=noise, wrench=wrench)


def _span(run: _core.RunData) -> float:
    """Time over which poses are averaged [s]."""
    least, most = 1 / RATE, windows.time_scale([run]) / RATE
    if not most > least:
        return least
    nu, along = np.array(run.nu), np.diff(np.array(run.times))
    turning = np.column_stack([-nu[:-1, 2] * nu[:-1, 1], nu[:-1, 2] * nu[:-1, 0], 0 * nu[:-1, 2]])
    accelerations = np.abs(np.diff(nu, axis=0) / along[:, None] + turning)
    strong = np.maximum(np.percentile(accelerations, 99, axis=0), 1e-300)  # that a run has now and then
    error = ERROR * np.array(run.noise)
    return float(np.clip(np.sqrt(24 * error / strong).min(), least, most))


def at_samples(run: _core.RunData, which: Union[slice, Flags]) -> _core.RunData:
    """The run at some of its samples."""
    eta, nu, poses = (
        np.array(values)[which] if len(values) else None for values in (run.eta, run.nu, run.poses)
    )
    return run.replaced(times=np.array(run.times)[which], eta=eta, nu=nu, poses=poses)


def by_poses_alone(run: _core.RunData) -> _core.RunData:
    """The run without inertial samples."""
    return run if run.inertial is None else run.replaced(inertial=_core.InertialData())


def _groups(times: Array, step: float, count: int) -> Indices:
    """First samples of groups of at most `count` that follow each other closely."""
    samples = np.arange(len(times))
    begins = np.diff(times, prepend=-np.inf) > UNEVEN * step
    since = samples - np.maximum.accumulate(np.where(begins, samples, 0))
    return np.asarray(np.flatnonzero(since % count == 0))
