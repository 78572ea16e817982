"""Accelerations of a repaired motion, and what else they depend on beside commands."""

from typing import List, Optional, Tuple

import numpy as np

from ground.poses import scatter
from ground.poses.repair import Motion
from ground.support.annotations import Array, Flags, Indices

OUTLIER = 6.0  # accelerations further from their median than so many scatters are cut
END = 5.0  # at the ends of stretches accelerations are inaccurate over this multiple of their blur
KERNEL = 3.0  # width of a mean that blurs as a smoother does, relative to its blur


def stretches(times: Array, inside: Flags, max_gap: float) -> List[Indices]:
    """Indices of the samples inside, split at gaps of more than max_gap [s]."""
    index = np.flatnonzero(inside)
    if not len(index):
        return []
    return np.split(index, np.flatnonzero(np.diff(times[index]) > max_gap) + 1)


def blur(motion: Motion) -> Tuple[float, float]:
    """Times over which the smoother averages velocities of the craft over the ground, and of its heading
    [s]."""
    jerks = motion.scales.linear_jerk, motion.scales.angular_jerk
    usual = scatter.interval(motion.times)
    linear, angular = ((n * np.sqrt(usual) / jerk) ** (1 / 3) for n, jerk in zip(motion.noise, jerks))
    return linear, angular


def averaged_over(motion: Motion) -> float:
    """Width of a mean that blurs accelerations as the smoother does [s]."""
    return KERNEL * max(blur(motion))


def accelerations(motion: Motion) -> Array:
    """Specific force in the body frame (n, 2) [m/s^2] and yaw acceleration [rad/s^2], (n, 3)."""
    u, v, r = motion.nu.T
    return np.asarray(motion.nu_dot + np.column_stack([-r * v, r * u, 0 * r]))


def smooth_terms(nu: Array) -> Array:
    """Regressors of the accelerations besides the commands, (n, 11)."""
    u, v, r = nu.T
    return np.column_stack(
        [np.ones(len(nu)), u, v, r, u * u, v * v, r * r, u * v, u * r, v * r, r * np.abs(r)]
    )


def without(rows: Array, base: Array) -> Array:
    """Rows (n, k) without their part in the span of an orthonormal base (n, m)."""
    return np.asarray(rows - base @ (base.T @ rows))


def residuals(regressors: Array, wanted: Array) -> Array:
    """What a linear regression leaves of columns wanted (n, k)."""
    return np.asarray(wanted - regressors @ np.linalg.lstsq(regressors, wanted, rcond=None)[0])


def squares_left(regressors: Array, wanted: Array) -> Array:
    """Sums of squares (k,) of what a linear regression leaves of columns wanted (n, k)."""
    across = regressors.T @ wanted
    solved = np.linalg.lstsq(regressors.T @ regressors, across, rcond=1e-12)[0]
    return np.asarray(np.maximum((wanted**2).sum(axis=0) - (across * solved).sum(axis=0), 0.0))


def middle(motion: Motion, times: Optional[Array] = None) -> Flags:
    """Samples away from the ends of stretches, where smoothed accelerations are inaccurate; of some of the
    motion's times, or all."""
    times = motion.times if times is None else times
    inside, margin = np.zeros(len(times), bool), END * max(blur(motion))
    for stretch in stretches(times, np.ones(len(times), bool), motion.scales.max_gap):
        start, end = times[stretch[0]], times[stretch[-1]]
        inside[stretch] = (times[stretch] > start + margin) & (times[stretch] < end - margin)
    return inside


def deviations(values: Array) -> Array:
    """Standard deviations (k,) of columns (n, k), by medians that outliers do not change."""
    return np.asarray(1.4826 * np.median(np.abs(values - np.median(values, axis=0)), axis=0))


def clipped(values: Array) -> Array:
    """Columns (n, k) without outliers."""
    centre, far = np.median(values, axis=0), OUTLIER * deviations(values)
    return np.asarray(np.clip(values, centre - far, centre + far))
